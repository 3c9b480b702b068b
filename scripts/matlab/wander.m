function wander(steps)
%WANDER Wander through the maze without hitting a wall: a sample to start your own program from.
%   wander(20) takes 20 steps; wander takes steps until Ctrl-C. Each step reads the sensors, then
%   drives forward where there is room, else turns towards a clear side.
%
%   See also SIMMER_OPEN, SIMMER_SEND, SIMMER_CLOSE.

if nargin < 1
    steps = Inf;
end
robot = simmer_open();
closing = onCleanup(@() simmer_close(robot)); % also after an error or Ctrl-C

sensors = {'u1', 'u2', 'u3', 'u4', 'u5', 'i1', 'o3', 'g1', 'c1'};
number = 0;
while number < steps
    number = number + 1;
    readings = zeros(size(sensors));
    for k = 1:numel(sensors)
        readings(k) = simmer_send(robot, sensors{k});
        if isnan(readings(k))
            error('simmer:refused', 'the robot knows no sensor %s (or it is disabled)', sensors{k});
        end
    end
    moves = decide(readings);
    values = [sensors; num2cell(readings)];
    fprintf('%d: %s-> %s\n', number, sprintf('%s=%.2f ', values{:}), strjoin(moves, ' '));
    for k = 1:numel(moves)
        if isnan(simmer_send(robot, moves{k}))
            error('simmer:refused', 'the robot refused %s: see the simulator''s log', moves{k});
        end
    end
end
end

function moves = decide(u)
% The commands for these distances (u1 to u5, in): forward, or towards a clear side, or a turn on the spot.
if u(1) > 4 && u(2) > 1.5 && u(4) > 1.5
    moves = {'d1-2'};
    return
end
sides = [2, 4];
turns = {'r1-90', 'r1--90'};
for k = randperm(2)
    if u(sides(k)) > 4
        moves = {turns{k}, 'd1-2'};
        return
    end
end
moves = {'r1-90'};
end

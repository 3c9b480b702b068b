function wander(steps)
%WANDER Wander through the maze without hitting a wall: a sample to start your own program from.
%   wander(20) takes 20 steps; wander takes steps until Ctrl-C. Each step reads the sensors, then
%   drives forward where there is room, else turns towards a clear side.
%
%   See also SIMMER_OPEN, SIMMER_READ, SIMMER_DRIVE, SIMMER_CLOSE.

if nargin < 1
    steps = Inf;
end
robot = simmer_open();
closing = onCleanup(@() simmer_close(robot)); % also after an error or Ctrl-C

sensors = {'u1', 'u2', 'u3', 'u4', 'u5', 'i1', 'o3', 'g1', 'c1'};
number = 0;
while number < steps
    number = number + 1;
    readings = simmer_read(robot, sensors{:}); % in one round trip
    moves = decide(readings);
    values = [sensors; num2cell(readings)];
    shown = moves.';
    fprintf('%d: %s->%s\n', number, sprintf('%s=%.2f ', values{:}), sprintf(' %s-%g', shown{:}));
    for k = 1:size(moves, 1)
        simmer_drive(robot, moves{k, :});
    end
end
end

function moves = decide(u)
% The movements for these distances (u1 to u5, in), a row of code and value each: forward, or towards a
% clear side, or a turn on the spot.
if u(1) > 4 && u(2) > 1.5 && u(4) > 1.5
    moves = {'d1', 2};
    return
end
sides = [2, 4];
turns = {90, -90};
for k = randperm(2)
    if u(sides(k)) > 4
        moves = {'r1', turns{k}; 'd1', 2};
        return
    end
end
moves = {'r1', 90};
end

function mission = simmer_mission(robot)
%SIMMER_MISSION The facts of the mission that a program may know.
%   mission = simmer_mission(robot) asks the simulator, over the robot's connection; that takes no
%   simulated time. The environment variables SIMMER_DROP_ZONE and SIMMER_TIME_LIMIT, where they are set,
%   count first. Without a mission it is an error.
%
%   mission.drop_zone      [x y], the middle of its cell, inches
%   mission.loading_zone   a row [x y] for each of its cells
%   mission.time_limit     simulated seconds
%   mission.gripper        the code of the gripper, such as p1
%   mission.start          [x y heading], or [] where the robot has to find out where it is
%
%   In programs with a connection of their own: ?m-1 gives the first of these numbers, ?m their count and
%   all of them (docs/mission.md).
%
%   See also SIMMER_OPEN, SIMMER_MAZE, SIMMER_DRIVE.

facts = reshape(simmer_send(robot, '?m', true), 1, []);
drop_zone = sscanf(getenv('SIMMER_DROP_ZONE'), '%f,%f').';
if numel(facts) < 7
    if numel(drop_zone) ~= 2
        error('simmer:mission', ...
            'the simulator has no mission: end it, and start simmer-tui --mission');
    end
    facts = [drop_zone Inf 0 NaN NaN NaN];
end
mission.drop_zone = facts(1:2);
if numel(drop_zone) == 2
    mission.drop_zone = drop_zone;
end
mission.loading_zone = reshape(facts(8:end), 2, []).';
mission.time_limit = facts(3);
limit = str2double(getenv('SIMMER_TIME_LIMIT'));
if ~isnan(limit)
    mission.time_limit = limit;
end
mission.gripper = '';
if facts(4) > 0
    mission.gripper = char([floor(facts(4) / 256) mod(facts(4), 256)]);
end
mission.start = facts(5:7);
if isnan(facts(5))
    mission.start = [];
end
end

function values = simmer_read(robot, varargin)
%SIMMER_READ Read sensors of the robot, all in one round trip.
%   distance = simmer_read(robot, 'u1') reads one, in its unit (inches, degrees).
%   values = simmer_read(robot, 'u1', 'u2', 'u4') reads several; values(2) is that of u2.
%   A code that no sensor has is an error. A lidar gives many numbers: see SIMMER_SCAN.
%
%   See also SIMMER_OPEN, SIMMER_SCAN, SIMMER_DRIVE, SIMMER_SEND, SIMMER_CLOSE.

values = simmer_send(robot, varargin);
unknown = find(isnan(values), 1);
if ~isempty(unknown)
    error('simmer:refused', ...
        'the robot knows no sensor %s, or it is disabled or did not answer: see sensors.csv', varargin{unknown});
end
end

function ranges = simmer_scan(robot, code)
%SIMMER_SCAN Read all ranges of a lidar.
%   ranges = simmer_scan(robot, 'sc') reads the last whole turn, ray by ray, in inches; Inf where a
%   ray met nothing in reach. One ray alone is simmer_send(robot, 'sc-90'), the one nearest to a
%   bearing.
%   A code that no lidar has is an error.
%
%   See also SIMMER_OPEN, SIMMER_READ, SIMMER_SEND, SIMMER_CLOSE.

if isstring(code)
    code = char(code);
end
if ~ischar(code) || numel(code) ~= 2
    error('simmer:invalid', 'the code of a lidar has two characters, such as sc');
end
ranges = simmer_send(robot, code, true);
if isempty(ranges)
    error('simmer:refused', '%s is no lidar: read it with simmer_read', code);
end
if isscalar(ranges) && isnan(ranges)
    error('simmer:refused', ...
        'the robot knows no lidar %s (or it is disabled): see its sensors.csv', code);
end
end

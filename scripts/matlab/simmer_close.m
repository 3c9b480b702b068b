function simmer_close(robot)
%SIMMER_CLOSE End the connection to the robot; doing it twice is harmless.
%   The robot stays where it is, and the next program can drive it.
%
%   See also SIMMER_OPEN, SIMMER_READ, SIMMER_DRIVE, SIMMER_SEND.

if isempty(robot('ended'))
    robot('ended') = 'simmer_close was called';
end
for name = {'replies', 'commands', 'beliefs'}
    if isKey(robot, name{1})
        remove(robot, name{1}); % the last reference to a tcpclient closes it
    end
end
end

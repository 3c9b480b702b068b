function movement = simmer_drive(robot, code, value)
%SIMMER_DRIVE Move the robot, and return what it said of it once the movement has ended.
%   simmer_drive(robot, 'd1', 3) drives 3 inches forward, simmer_drive(robot, 'r1', -90) turns clockwise.
%   movement = simmer_drive(...) has the fields command (as it was sent), reply (the number that came back)
%   and ended (true where that is Inf, as the simulator says it). A wall may have ended the movement early:
%   the robot has no word for that, so read a sensor. A command that is refused is an error.
%
%   See also SIMMER_OPEN, SIMMER_READ, SIMMER_SEND, SIMMER_CLOSE.

if ~(ischar(code) || isstring(code))
    error('simmer:invalid', 'the code of a drive must be text, such as ''d1''');
end
code = char(code); % in MATLAB "d1" is a string, which [] would not join
if ~(isnumeric(value) && isreal(value) && isscalar(value) && isfinite(value))
    error('simmer:invalid', 'the value of %s must be one finite number', code);
end
command = [code '-' num2str(value, 17)];
reply = simmer_send(robot, command);
if isnan(reply)
    error('simmer:refused', ['the robot refused %s: no enabled drive has that code (see drive.csv), the ' ...
        'value is beyond 1e6, or the robot is still moving'], command);
end
movement = struct('command', command, 'reply', reply, 'ended', isinf(reply));
end

function value = simmer_send(robot, command, scan)
%SIMMER_SEND Send a command to the robot and wait for the number that comes back.
%   value = simmer_send(robot, 'u1') reads a sensor.
%   values = simmer_send(robot, {'u1', 'u2'}) sends several in one round trip.
%   simmer_send(robot, 'd1-3') or simmer_send(robot, ['r1-' num2str(angle)]) moves the robot and
%   returns Inf when the movement has ended. NaN says that the command was refused.
%   ranges = simmer_send(robot, 'sc', true) asks a lidar, which answers with a count and so many
%   numbers: see SIMMER_SCAN.
%
%   Bytes that are left over from a reply say that robot('reply_format') is not the simulator's:
%   what came next would be nonsense, so it is an error.
%
%   After a timeout or Ctrl-C in the middle of a command the connection is closed, as a late
%   reply would be taken for the answer to the next command: call simmer_open again.
%
%   See also SIMMER_OPEN, SIMMER_READ, SIMMER_SCAN, SIMMER_DRIVE, SIMMER_CLOSE.

scan = nargin > 2 && scan;
commands = cellfun(@char, cellstr_of(command), 'UniformOutput', false);
for k = 1:numel(commands)
    text = commands{k};
    if size(text, 1) > 1 || numel(text) > 255 || any(text < ' ' | text > '~')
        error('simmer:invalid', ...
            'a command is one row of at most 255 printable ASCII characters, such as d1-3');
    end
end
command = strjoin(reshape(commands, 1, []), ' ');
if ~isempty(robot('pending')) && isKey(robot, 'commands')
    robot('ended') = [robot('pending') ' was cut short'];
    simmer_close(robot);
end
if ~isKey(robot, 'commands')
    error('simmer:closed', 'the connection has ended (%s): call simmer_open again', robot('ended'));
end
switch robot('reply_format')
    case 'float64'
        class_name = 'double';
        width = 8;
    case 'float32'
        class_name = 'single';
        width = 4;
    otherwise
        error('simmer:invalid', 'robot(''reply_format'') must be ''float64'' or ''float32''');
end
count = width * numel(commands);
if ~any(strcmp(robot('byte_order'), {'big', 'little'}))
    error('simmer:invalid', 'robot(''byte_order'') must be ''big'' or ''little''');
end

wrong_format = ['robot(''reply_format'') and robot(''byte_order'') must be the simulator''s own ' ...
    '(its settings.toml); call simmer_open again'];

left = bytes_waiting(robot('replies'));
if left > 0
    end_with(robot, 'simmer:format', sprintf('%d bytes were left over before ''%s'': %s', ...
        left, command, wrong_format));
end
robot('pending') = ['''' command ''''];
try
    lines = cellfun(@(text) [uint8(text), 10], commands, 'UniformOutput', false);
    write(robot('commands'), [lines{:}]);
    bytes = receive(robot('replies'), count, robot('timeout'));
    if scan && numel(bytes) == count
        rays = numbers(robot, bytes, width, class_name);
        % A whole number may be another sensor's reading: then nothing follows.
        if is_count(rays) && more_comes(robot('replies'))
            count = width * rays;
            bytes = receive(robot('replies'), count, robot('timeout'));
        elseif ~isnan(rays) && bytes_waiting(robot('replies')) == 0
            robot('pending') = '';
            value = [];
            return;
        end
    end
catch problem
    end_with(robot, 'simmer:closed', sprintf( ...
        ['the simulator closed the connection before it answered ''%s'' (%s): it has ended, or ' ...
        'another program is driving the robot (one at a time)'], command, problem.message));
end
if numel(bytes) < count
    came = numel(bytes) + bytes_waiting(robot('replies')); % Octave leaves what is too little
    hint = '';
    if came > 0
        hint = ': does robot(''reply_format'') match the simulator''s?';
    end
    end_with(robot, 'simmer:timeout', sprintf('no reply to ''%s'' within %g s (%d of %d bytes came%s)', ...
        command, robot('timeout'), came, count, hint));
end
left = bytes_waiting(robot('replies'));
if left > 0 && ~scan && numel(commands) == 1 && is_count(numbers(robot, bytes, width, class_name))
    rays = numbers(robot, bytes, width, class_name);
    if left <= width * rays && numel(receive(robot('replies'), width * rays, robot('timeout'))) == width * rays
        robot('pending') = '';
        error('simmer:refused', '%s is a lidar: simmer_scan gives all its ranges, simmer_send(robot, ''%s-90'') one', ...
            command, command);
    end
end
if left > 0
    if numel(commands) > 1
        wrong_format = ['a lidar is among them (see simmer_scan), or ' wrong_format];
    end
    end_with(robot, 'simmer:format', sprintf('the reply to ''%s'' is %d bytes longer than a %s: %s', ...
        command, left, robot('reply_format'), wrong_format));
end
robot('pending') = '';

value = numbers(robot, bytes, width, class_name);
end

function value = numbers(robot, bytes, width, class_name)
host_is_big = typecast(uint8([0 1]), 'uint16') == 1;
if host_is_big ~= strcmp(robot('byte_order'), 'big')
    bytes = reshape(flipud(reshape(bytes, width, [])), 1, []);
end
value = double(typecast(bytes, class_name));
end

function yes = is_count(number)
yes = number >= 1 && number <= 4000 && number == fix(number);
end

function yes = more_comes(connection)
for k = 1:20
    yes = bytes_waiting(connection) > 0;
    if yes
        return;
    end
    pause(0.01);
end
end

function commands = cellstr_of(command)
if isstring(command) % MATLAB's "u1", or an array of them
    command = cellstr(command);
end
if iscell(command)
    commands = reshape(command, 1, []);
else
    commands = {command};
end
if isempty(commands)
    error('simmer:invalid', 'there is no command to send');
end
end

function bytes = receive(connection, count, timeout)
if exist('OCTAVE_VERSION', 'builtin')
    set(connection, 'Timeout', timeout);
else
    connection.Timeout = timeout;
end
bytes = reshape(uint8(read(connection, count, 'uint8')), 1, []);
end

function count = bytes_waiting(connection)
% A reply is read whole before the next command goes, so nothing may wait before or after one.
try
    count = connection.NumBytesAvailable;
catch
    count = 0; % the connection has ended; the next read or write says so
end
end

function end_with(robot, identifier, message)
robot('ended') = message;
simmer_close(robot);
error(identifier, '%s', message);
end

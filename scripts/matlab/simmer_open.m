function robot = simmer_open(host, port, reply_port)
%SIMMER_OPEN Connect to a robot in the simulator.
%   robot = simmer_open() connects to the host and ports in the environment variables SIMMER_HOST,
%   SIMMER_PORT and SIMMER_REPLY_PORT, else to 127.0.0.1, 9000 and 9001.
%   robot = simmer_open(host, port) and simmer_open(host, port, reply_port) connect there. Beside
%   another command port than 9000 the usual reply port is 0: replies come back on the command
%   port. They do too where nobody listens on the reply port.
%
%   If the simulator's settings.toml says so, set robot('reply_format') = 'float32' or
%   robot('byte_order') = 'little' afterwards. robot('timeout') is in seconds.
%
%   Needs MATLAB R2021a, or Octave with the instrument-control package.
%   See also SIMMER_READ, SIMMER_DRIVE, SIMMER_SEND, SIMMER_MAZE, SIMMER_MISSION,
%   SIMMER_CLOSE, WANDER.

if exist('OCTAVE_VERSION', 'builtin')
    pkg('load', 'instrument-control');
end
if nargin < 1 || isempty(host)
    host = getenv('SIMMER_HOST');
    if isempty(host)
        host = '127.0.0.1';
    end
end
if nargin < 2 || isempty(port)
    port = port_from_environment('SIMMER_PORT', 9000);
end
check_port('the port', port, 1);
if nargin < 3 || isempty(reply_port)
    % Beside another command port, 9001 may well belong to somebody else's simulator.
    reply_port = port_from_environment('SIMMER_REPLY_PORT', 9001 * (port == 9000));
end
check_port('the reply port', reply_port, 0);

% A map is a handle: what simmer_send learns about the connection is known to every copy of robot.
robot = containers.Map('KeyType', 'char', 'ValueType', 'any');
robot('reply_format') = 'float64';
robot('byte_order') = 'big';
robot('timeout') = 30;
robot('pending') = '';
robot('ended') = '';
robot('host') = host;
try
    commands = connect(host, port);
catch problem
    error('simmer:unreachable', ...
        ['no simulator answers on %s port %d (%s): is it running? Start it with simmer-tui ' ...
        '(add --no-ui for no screen), or give simmer_open its host and port'], ...
        host, port, problem.message);
end
replies = commands;
if reply_port > 0
    try
        replies = connect(host, reply_port);
    catch
        replies = commands; % newer programs need no second connection, so its absence is no error
    end
end
robot('commands') = commands;
robot('replies') = replies;
end

function connection = connect(host, port)
if exist('OCTAVE_VERSION', 'builtin')
    connection = tcpclient(host, port);
else
    % Without this, Nagle's algorithm holds every second command back for up to 40 ms.
    connection = tcpclient(host, port, 'ConnectTimeout', 10, 'EnableTransferDelay', false);
end
end

function port = port_from_environment(name, default)
text = strtrim(getenv(name));
if isempty(text)
    port = default;
elseif isempty(regexp(text, '^\d+$', 'once'))
    error('simmer:invalid', 'the environment variable %s is ''%s'': a port is a whole number', name, text);
else
    port = str2double(text);
end
end

function check_port(name, port, lowest)
if ~(isnumeric(port) && isscalar(port) && port == fix(port) && port >= lowest && port <= 65535)
    error('simmer:invalid', '%s must be a whole number from %d to 65535', name, lowest);
end
end

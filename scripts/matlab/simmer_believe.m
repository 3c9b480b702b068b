function simmer_believe(robot, varargin)
%SIMMER_BELIEVE Show where the program believes the robot to be, beside where it is.
%   simmer_believe(robot, 'x', 12, 'y', 42, 'heading', 0, 'spread', 1.5) tells a pose, in inches and degrees.
%   simmer_believe(robot, 'grid', p) tells a probability for each cell: rows x columns, or rows x columns x
%   headings, at most 65,536 in all. Row 1 is on top, as in maze.csv; the first heading is 0 degrees, the
%   others follow counterclockwise. They need not sum to 1. The pose may be left out then: it is that of the
%   best cell.
%   simmer_believe(..., 'bounds', [x0 y0 x1 y1], 'first', 45, 'note', 'text') says where the grid lies
%   (by default it covers the maze), its first heading, and a note.
%
%   Where nobody listens nothing happens. The port is SIMMER_BELIEF_PORT, else 9002.
%   See also SIMMER_OPEN, SIMMER_READ, SIMMER_DRIVE.

parts = {};
grid = {};
names = {};
for k = 1:2:numel(varargin)
    if k == numel(varargin) || ~(ischar(varargin{k}) || isstring(varargin{k}))
        error('simmer:invalid', 'simmer_believe takes pairs, such as ''x'', 12, or ''grid'', p');
    end
    name = char(varargin{k});
    names{end + 1} = name; %#ok<AGROW>
    value = varargin{k + 1};
    switch name
        case {'x', 'y', 'heading', 'spread'}
            parts{end + 1} = ['"' name '":' number(name, value)]; %#ok<AGROW>
            if strcmp(name, 'spread') && value < 0
                error('simmer:invalid', 'spread is %g: it must be 0 or more', value);
            end
        case 'note'
            parts{end + 1} = ['"note":"' quoted(value) '"']; %#ok<AGROW>
        case 'grid'
            grid = [packed(value), grid];
        case 'first'
            grid{end + 1} = ['"first":' number(name, value)]; %#ok<AGROW>
        case 'bounds'
            if numel(value) ~= 4
                error('simmer:invalid', 'bounds must be [x0 y0 x1 y1], inches');
            end
            edges = arrayfun(@(each) number(name, each), value(:)', 'UniformOutput', false);
            grid{end + 1} = ['"bounds":[' strjoin(edges, ',') ']']; %#ok<AGROW>
        otherwise
            error('simmer:invalid', ...
                '''%s'' is not known; there are x, y, heading, spread, grid, bounds, first, note', name);
    end
end
if ~any(strcmp(names, 'grid'))
    missing = setdiff({'x', 'y', 'heading'}, names, 'stable');
    if ~isempty(missing)
        error('simmer:invalid', '%s is missing: only a belief with a grid may leave it out', missing{1});
    elseif ~isempty(grid)
        error('simmer:invalid', 'bounds and first are those of a grid: there is none');
    end
end
if ~isempty(grid)
    parts{end + 1} = ['"grid":{' strjoin(grid, ',') '}'];
end
tell(robot, ['{' strjoin(parts, ',') '}']);
end

function fields = packed(p)
% Sizes and numbers of a grid. The numbers go as bytes of single precision, a quarter of what text takes.
if ~(isnumeric(p) && isreal(p) && ndims(p) <= 3 && ~isempty(p) && all(isfinite(p(:))) && all(p(:) >= 0) ...
        && any(p(:) > 0))
    error('simmer:invalid', ...
        'grid must be rows x columns x headings of finite numbers, 0 or more, and one of them more than 0');
end
if numel(p) > 65536
    error('simmer:invalid', 'grid has %d states: it may have 65536', numel(p));
end
p = double(p) / max(double(p(:)));
values = permute(p, [3 2 1]); % heading fastest, then the columns of a row
values = single(values(:)');
[~, ~, order] = computer();
if order == 'B'
    values = swapbytes(values);
end
bytes = typecast(values, 'uint8');
if exist('OCTAVE_VERSION', 'builtin')
    text = base64_encode(bytes);
else
    text = matlab.net.base64encode(bytes);
end
fields = {sprintf('"rows":%d,"cols":%d,"headings":%d', size(p, 1), size(p, 2), size(p, 3)), ...
    ['"f32":"' text '"']};
end

function text = number(name, value)
if ~(isnumeric(value) && isscalar(value) && isreal(value) && isfinite(value))
    error('simmer:invalid', '%s must be a finite number', name);
end
text = sprintf('%.9g', double(value));
end

function text = quoted(value)
text = regexprep(char(value), '[^ -~]', ' ');
text = strrep(strrep(text, '\', '\\'), '"', '\"');
end

function tell(robot, line)
if ~isKey(robot, 'commands') || isKey(robot, 'deaf')
    return
end
try
    if ~isKey(robot, 'beliefs')
        port = str2double(getenv('SIMMER_BELIEF_PORT'));
        if isnan(port)
            port = 9002;
        end
        robot('beliefs') = tcpclient(robot('host'), port);
    end
    write(robot('beliefs'), [uint8(line), 10]);
catch
    robot('deaf') = true; % for good: it is only drawn, and each attempt takes time
end
end

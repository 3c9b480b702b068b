function cells = simmer_maze(name)
%SIMMER_MAZE The maze as a matrix: 0 wall, 1 empty, 2 robot start, 3 block; the first row is the top.
%   cells = simmer_maze() is the maze of the set that the simulator names to a program it runs, else that
%   of the folder config here, else the default. Cells are 12 x 12 inches.
%   cells = simmer_maze('mission') is that of another set: a folder, or a bundled one by name.
%
%   SimMeR-TUI reads the set, so simmer-tui must be installed and on the PATH. All that it knows of the
%   set is in jsondecode of the same command: simmer-tui check mission --json.
%
%   See also SIMMER_OPEN, SIMMER_READ.

if nargin < 1
    file = getenv('SIMMER_MAZE');
    if ~isempty(file)
        cells = dlmread(file, ',');
        return
    end
    name = getenv('SIMMER_CONFIG');
end
if ~isempty(name)
    name = ['"' char(name) '"'];
end
[code, text] = system(['simmer-tui check ' name ' --json']);
if code ~= 0
    try % its answer names the problem
        problem = jsondecode(text).problems(1);
        text = [problem.where ': ' problem.text];
    catch
        text = sprintf('simmer-tui check %s has no maze to give: %s', name, strtrim(text));
    end
    error('simmer:maze', '%s', text);
end
set = jsondecode(text);
cells = set.maze.cells;
end

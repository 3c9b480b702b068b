function simmer_sleep(robot, seconds)
%SIMMER_SLEEP Let the robot's time pass, while it continues its motion.
%   simmer_sleep(robot, 2) returns when two seconds of the robot's time are over. The simulator's time is
%   not MATLAB's, so that pause(2) moves a driving robot hardly at all. A robot that has no command to
%   wait is an error: use pause there.
%
%   See also SIMMER_SEND, SIMMER_DRIVE.

if ~(isnumeric(seconds) && isscalar(seconds) && isfinite(seconds) && seconds >= 0)
    error('simmer:invalid', 'the seconds to sleep must be one number, 0 or more');
end
usual = robot('timeout');
restored = onCleanup(@() set_timeout(robot, usual));
set_timeout(robot, usual + seconds); % in timed motion the answer comes when the time is over
if ~isinf(simmer_send(robot, ['wt-' num2str(seconds, 17)]))
    error('simmer:refused', 'the robot refused to wait: use pause(%g)', seconds);
end
end

function set_timeout(robot, seconds)
robot('timeout') = seconds;
end

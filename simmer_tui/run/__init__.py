"""The state, history and outcome of a run, computed from its events alone.

In: events, frozen records of what has happened, in order.
Out: the state at a moment, the history of the run, the mission's verdict, and their wording.

`reducer.py` fills state and history, live and in a replay. `state.py` is for screens, `run_history.py` for
reports, trials and calibration. `mission.py` has the referee, `events.py` all events.
"""

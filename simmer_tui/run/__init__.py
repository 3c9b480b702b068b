"""The state, history and outcome of a run, computed from its events alone.

In: events, frozen records of what has happened, in order.
Out: the state at a moment, the history of the run, the mission's verdict, and their wording.
"""

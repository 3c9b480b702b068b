"""One robot behind one queue, and its clock.

In: commands of programs and people, and people's actions.
Out: a `CommandResult` for each command, and events for the watchers.

In instant motion simulated time passes with commands only. `Engine.tell` passes every event on.
"""

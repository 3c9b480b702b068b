"""The run model: one reducer from events to the state of a run and to the history of all that happened."""

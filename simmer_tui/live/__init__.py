"""A run that is going on, and the people who operate it.

In: a configuration, the robot and its links, and orders of people.
Out: the robot's thread with its ports, and frozen snapshots for screens and pages.

`server.py` builds a run from its configuration: there settings reach robot, links and referee. A real
robot gets its own whole.
"""

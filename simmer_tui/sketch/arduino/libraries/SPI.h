// Nothing of the simulated robot is on this bus: other libraries of a sketch may include it, and no sketch may use it.
#pragma once

// Arduino.h has it.
#pragma once
#include "../core/Arduino.h"

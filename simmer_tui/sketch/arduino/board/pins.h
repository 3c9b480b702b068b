// Levels of the pins, as the sketch sets them and as the world does.
#pragma once
#include "clock.h"

namespace board {

constexpr int PINS = 80;

void set_input(int pin, int level);  // an edge from outside
int input_level(int pin);            // the level at a pin: the world's, or its pull-up
// Pins that drive something, or trigger a sonar: their changes are passed on at their own time.
void mark_driving(int pin);
void mark_trigger(int pin);
void mark_stepping(int pin);         // each rise is told as a step, with its place in the sketch
void mark_asked(int pin);            // a digital sensor: its level is asked for when it is read

}  // namespace board

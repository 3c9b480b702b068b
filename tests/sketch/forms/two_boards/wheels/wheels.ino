// The second board: motors and an encoder; it answers with its ticks.
#include <SoftwareSerial.h>
#include "pins.h"
SoftwareSerial sensor(A4, A5);
volatile unsigned int ticks = 0;

void setup() {
  sensor.begin(9600);
  setupMotors();
  attachInterrupt(digitalPinToInterrupt(ENCODER), countTick, CHANGE);
}

void loop() {
  if (sensor.available()) {
    String line = sensor.readStringUntil('\n');
    line.trim();
    if (line.length() == 0) return;
    char what = line.charAt(0);
    int value = line.substring(1).toInt();
    if (what == 'F') both(value, value);
    if (what == 'L') both(-value, value);
    if (what == 'S') both(0, 0);
    sensor.print(what);
    sensor.print(':');
    sensor.println(ticks);
  }
}

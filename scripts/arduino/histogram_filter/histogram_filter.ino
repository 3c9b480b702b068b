// A robot that finds out where it is on an Arduino Mega, by the histogram filter of histogram.h.
//
// Beside this sketch belongs the table of what its sensors read in its maze; make another for your set:
//   simmer-tui atlas atlas.h --step 6 --headings 8 --sensors u1,u2,u3,u4
// Start the robot square to the walls: it keeps to right angles, on which the headings of the table lie.
// Replace readSensor, readGyro and drive by what your robot has.

#include "histogram.h"

const float SURE = 0.7;   // probability of the best pose from which on it tells where it is
const float STRIDE = 6;   // in
float gyroAtLast = 0;     // deg, turned since the start, when the belief was last moved

// The distance a sensor of atlas.h measures, in inches: on A0 the first, on A1 the second and so on.
float readSensor(uint8_t sensor) {
  return analogRead(A0 + sensor) * (36.0 / 1023);
}

// The angle turned since the start, degrees, counter-clockwise.
float gyro = 0;
float readGyro() {
  return gyro;
}

// Drive ahead by inches, or turn by degrees, and come back when it is done; returns the inches really driven.
float drive(float ahead, float turn) {
  delay((fabs(ahead) + fabs(turn) / 10) * 100);  // your motors go here
  gyro += turn;
  return ahead;
}

// Drive or turn, and move the belief by what was counted.
void go(float ahead, float turn) {
  float driven = drive(ahead, turn);
  float now = readGyro();
  predict(driven, now - gyroAtLast);
  gyroAtLast = now;
}

void setup() {
  Serial.begin(9600);
  scatter();
}

void loop() {
  float ahead = 0;
  for (uint8_t sensor = 0; sensor < ATLAS_SENSORS; sensor++) {
    float reading = readSensor(sensor);
    if (sensor == 0) ahead = reading;
    update(sensor, reading);
  }
  uint16_t row = 0, column = 0, heading = 0;
  float probability = best(row, column, heading);
  if (probability > SURE) {
    Serial.print((column + 0.5) * ATLAS_STEP, 0);
    Serial.print(' ');
    Serial.print((ATLAS_ROWS - row - 0.5) * ATLAS_STEP, 0);
    Serial.print(' ');
    Serial.print(heading * 360.0 / ATLAS_HEADINGS, 0);
    Serial.print('\n');
  }
  static uint8_t moves = 0;
  if (ahead > STRIDE + 3 && moves++ % 3 < 2) {
    go(STRIDE, 0);
  } else {
    // To the next right angle on the left, by what the gyroscope has counted.
    go(0, 90 * (round(gyroAtLast / 90) + 1) - gyroAtLast);
  }
}

// Two wheels on drivers for steppers: a line such as "D300" drives 300 steps, "T150" turns.
#include <AccelStepper.h>

#define STEP_LEFT 22
#define DIR_LEFT 24
#define ENABLE_LEFT 26
#define STEP_RIGHT 28
#define DIR_RIGHT 30
#define ENABLE_RIGHT 32

AccelStepper leftWheel(AccelStepper::DRIVER, STEP_LEFT, DIR_LEFT);
AccelStepper rightWheel(AccelStepper::DRIVER, STEP_RIGHT, DIR_RIGHT);

bool driving = false;
long odometer = 0;

void begin(AccelStepper &wheel, int enable, bool mirrored) {
  wheel.setMaxSpeed(900);
  wheel.setAcceleration(1500);
  wheel.setPinsInverted(mirrored, false, true);
  wheel.setEnablePin(enable);
  wheel.enableOutputs();
}

void setup() {
  Serial.begin(9600);
  begin(leftWheel, ENABLE_LEFT, false);
  begin(rightWheel, ENABLE_RIGHT, true);
  Serial.println("ready");
}

void start(long left, long right) {
  leftWheel.move(left);
  rightWheel.move(right);
  odometer += abs(left) + abs(right);
  driving = true;
}

void loop() {
  if (Serial.available()) {
    char what = Serial.read();
    long steps = Serial.parseInt();
    if (what == 'D') start(steps, steps);
    if (what == 'T') start(-steps, steps);
    if (what == 'S') { leftWheel.stop(); rightWheel.stop(); }
  }
  leftWheel.run();
  rightWheel.run();
  if (driving && !leftWheel.isRunning() && !rightWheel.isRunning()) {
    driving = false;
    Serial.print(leftWheel.currentPosition());
    Serial.print(' ');
    Serial.print(rightWheel.currentPosition());
    Serial.print(' ');
    Serial.println(odometer);
  }
}

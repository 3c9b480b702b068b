// Two 28BYJ-48 with ULN2003 boards: both wheels take turns, a step each.
#include <Stepper.h>

const int STEPS = 2048;
Stepper left(STEPS, 2, 4, 3, 5);
Stepper right(STEPS, 8, 10, 9, 11);

void goForward(int count) {
  for (int i = 0; i < count; i++) {
    left.step(1);
    right.step(-1);
  }
}

void turnRight(int count) {
  for (int i = 0; i < count; i++) {
    left.step(1);
    right.step(1);
  }
}

void setup() {
  Serial.begin(9600);
  left.setSpeed(14);
  right.setSpeed(14);
  goForward(600);
  Serial.println(millis() / 100);
  turnRight(200);
  Serial.println("done");
}

void loop() {}

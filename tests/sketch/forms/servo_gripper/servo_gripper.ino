// A gripper on a servo, swept degree by degree; letters o and c open and close it.
#include <Servo.h>
Servo gripper;
const int OPEN_ANGLE = 20, CLOSED_ANGLE = 95;
int angle = OPEN_ANGLE;

void moveTo(int goal) {
  while (angle != goal) {
    angle += angle < goal ? 1 : -1;
    gripper.write(angle);
    delay(5);
  }
}

void setup() {
  gripper.attach(9);
  gripper.write(angle);
  Serial.begin(9600);
  Serial.println("gripper");
}

void loop() {
  if (Serial.available() == 0) return;
  switch (Serial.read()) {
    case 'o': moveTo(OPEN_ANGLE); Serial.println("open"); break;
    case 'c': moveTo(CLOSED_ANGLE); Serial.println("closed"); break;
    case '?': Serial.println(gripper.read()); break;
  }
}

// A driver with two inputs a motor, PWM on either: forward on one pin, backward on the other.
const int AIA = 9, AIB = 10, BIA = 5, BIB = 6;

void setMotor(int one, int two, int speed) {
  if (speed >= 0) {
    analogWrite(one, speed);
    analogWrite(two, 0);
  } else {
    analogWrite(one, 0);
    analogWrite(two, -speed);
  }
}

void setup() {
  pinMode(AIA, OUTPUT);
  pinMode(AIB, OUTPUT);
  pinMode(BIA, OUTPUT);
  pinMode(BIB, OUTPUT);
  randomSeed(analogRead(A3));
}

void loop() {
  int speed = random(60, 200);
  setMotor(AIA, AIB, speed);
  setMotor(BIA, BIB, speed);
  delay(random(200, 500));
  setMotor(AIA, AIB, -speed / 2);
  setMotor(BIA, BIB, speed / 2);
  delay(150);
}

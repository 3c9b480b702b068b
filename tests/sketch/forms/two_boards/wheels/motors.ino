// A further tab of the sketch.
void countTick() { ticks++; }

void setupMotors() {
  for (int i = 0; i < 6; i++) pinMode(MOTOR_PINS[i], OUTPUT);
  pinMode(ENCODER, INPUT);
}

void both(int left, int right) {
  digitalWrite(MOTOR_PINS[1], left > 0);
  digitalWrite(MOTOR_PINS[2], left < 0);
  digitalWrite(MOTOR_PINS[4], right > 0);
  digitalWrite(MOTOR_PINS[5], right < 0);
  analogWrite(MOTOR_PINS[0], abs(left));
  analogWrite(MOTOR_PINS[3], abs(right));
}

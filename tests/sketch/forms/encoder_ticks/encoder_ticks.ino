// Straight on for a number of ticks; encoders of both wheels by interrupt, one with a direction.
#define ENC_LEFT_A 2
#define ENC_LEFT_B 4
#define ENC_RIGHT 3
volatile long leftTicks = 0;
volatile long rightTicks = 0;
const int pwm[2] = {5, 6};
const int dirs[2][2] = {{7, 8}, {9, 10}};

void leftEdge() {
  if (digitalRead(ENC_LEFT_B)) leftTicks--;
  else leftTicks++;
}
void rightEdge() { rightTicks++; }

void setWheel(int side, int duty) {
  digitalWrite(dirs[side][0], duty > 0);
  digitalWrite(dirs[side][1], duty < 0);
  analogWrite(pwm[side], abs(duty));
}

bool driveTicks(long goal, int duty) {
  leftTicks = rightTicks = 0;
  setWheel(0, duty);
  setWheel(1, duty);
  unsigned long begun = millis();
  while (leftTicks < goal || rightTicks < goal) {
    long error = leftTicks - rightTicks;
    setWheel(0, duty - (int)error);
    setWheel(1, duty + (int)error);
    if (millis() - begun > 3000) return false;
  }
  setWheel(0, 0);
  setWheel(1, 0);
  return true;
}

void setup() {
  Serial.begin(9600);
  for (int side = 0; side < 2; side++) {
    pinMode(pwm[side], OUTPUT);
    pinMode(dirs[side][0], OUTPUT);
    pinMode(dirs[side][1], OUTPUT);
  }
  pinMode(ENC_LEFT_A, INPUT_PULLUP);
  pinMode(ENC_LEFT_B, INPUT_PULLUP);
  pinMode(ENC_RIGHT, INPUT_PULLUP);
  attachInterrupt(digitalPinToInterrupt(ENC_LEFT_A), leftEdge, RISING);
  attachInterrupt(digitalPinToInterrupt(ENC_RIGHT), rightEdge, RISING);
  delay(200);
  bool ok = driveTicks(60, 150);
  Serial.print(ok ? "done " : "timeout ");
  Serial.print(leftTicks);
  Serial.print(' ');
  Serial.println(rightTicks);
}

void loop() {}

// Two encoders by interrupt, PWM until their count is reached, and a stop by byte.
const int EN = 5, IN1 = 7, IN2 = 8;
volatile long left = 0, right = 0;
long target = 0;

void leftEdge() { left++; }
void rightEdge() { right++; }

void drive(int duty) {
  digitalWrite(IN1, duty > 0 ? HIGH : LOW);
  digitalWrite(IN2, duty < 0 ? HIGH : LOW);
  analogWrite(EN, abs(duty));
}

void setup() {
  Serial.begin(9600);
  pinMode(EN, OUTPUT);
  pinMode(IN1, OUTPUT);
  pinMode(IN2, OUTPUT);
  attachInterrupt(digitalPinToInterrupt(2), leftEdge, CHANGE);
  attachInterrupt(digitalPinToInterrupt(3), rightEdge, RISING);
}

void loop() {
  if (Serial.available() > 0) {
    char what = Serial.read();
    if (what == 'F') { left = 0; target = 100; drive(180); }
    if (what == 'B') drive(-90);
    if (what == 'S') { drive(0); Serial.println(left > 0 ? "stopped" : "stood"); }
  }
  if (target > 0 && left >= target) {
    drive(0);
    target = 0;
    Serial.print("done ");
    Serial.println(left);
  }
}

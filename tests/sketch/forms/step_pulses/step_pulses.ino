// A shield for steppers (A4988), pulsed by hand.
const int stepPins[2] = {2, 3};
const int dirPins[2] = {5, 6};
const int enablePin = 8;
const unsigned int PERIOD = 1500;  // microseconds of a step

void pulse(int left, int right) {
  if (left) digitalWrite(stepPins[0], HIGH);
  if (right) digitalWrite(stepPins[1], HIGH);
  delayMicroseconds(5);
  digitalWrite(stepPins[0], LOW);
  digitalWrite(stepPins[1], LOW);
}

void steps(int count, unsigned int period = PERIOD) {
  for (int i = 0; i < count; i++) {
    pulse(1, 1);
    delayMicroseconds(period);
  }
}

void goForward() {
  digitalWrite(dirPins[0], HIGH);
  digitalWrite(dirPins[1], LOW);
  steps(400);
}

void turnLeft() {
  digitalWrite(dirPins[0], LOW);
  digitalWrite(dirPins[1], LOW);
  steps(150, PERIOD * 2);
}

void setup() {
  Serial.begin(9600);
  for (int i = 0; i < 2; i++) {
    pinMode(stepPins[i], OUTPUT);
    pinMode(dirPins[i], OUTPUT);
  }
  pinMode(enablePin, OUTPUT);
  digitalWrite(enablePin, LOW);
  goForward();
  Serial.println("forward");
  turnLeft();
  Serial.println("left");
  digitalWrite(enablePin, HIGH);
}

void loop() {}

// HC-SR04 by pulseIn, with a timeout; and a line sensor by analogRead.
const int trigPins[2] = {2, 4};
const int echoPins[2] = {3, 5};
const int linePin = A0;

float inches(int which) {
  digitalWrite(trigPins[which], LOW);
  delayMicroseconds(2);
  digitalWrite(trigPins[which], HIGH);
  delayMicroseconds(10);
  digitalWrite(trigPins[which], LOW);
  long duration = pulseIn(echoPins[which], HIGH, 25000);
  return duration / 148.0;
}

void setup() {
  for (int i = 0; i < 2; i++) {
    pinMode(trigPins[i], OUTPUT);
    pinMode(echoPins[i], INPUT);
  }
  Serial.begin(115200);
}

void loop() {
  Serial.print("A: ");
  Serial.print(inches(0));
  Serial.print(" B: ");
  Serial.print(inches(1), 1);
  Serial.print(" line: ");
  Serial.println(analogRead(linePin));
  delay(60);
}

// Drives a square by time alone: the only library call that waits is delay().
int enA = 9, in1 = 8, in2 = 7;
int enB = 3, in3 = 5, in4 = 4;

void setup() {
  pinMode(enA, OUTPUT); pinMode(enB, OUTPUT);
  pinMode(in1, OUTPUT); pinMode(in2, OUTPUT); pinMode(in3, OUTPUT); pinMode(in4, OUTPUT);
  stopAll();
  delay(500);
}

void loop() {
  straight();
  delay(400);
  stopAll();
  delay(200);
  spin();
  delay(230);
  stopAll();
  delay(200);
}

void straight() {
  digitalWrite(in1, HIGH); digitalWrite(in2, LOW);
  digitalWrite(in3, HIGH); digitalWrite(in4, LOW);
  analogWrite(enA, 150); analogWrite(enB, 150);
}

void spin() {
  digitalWrite(in1, LOW);  digitalWrite(in2, HIGH);
  digitalWrite(in3, HIGH); digitalWrite(in4, LOW);
  analogWrite(enA, 120); analogWrite(enB, 120);
}

void stopAll() {
  analogWrite(enA, 0);
  analogWrite(enB, 0);
}

// A planted fault: the stop waits behind delay(200), while the robot drives on.
const byte ENA = 5, IN1 = 7, IN2 = 8, ENB = 6, IN3 = 9, IN4 = 10;

void setup() {
  for (byte pin = ENA; pin <= IN4; pin++) pinMode(pin, OUTPUT);
  Serial.begin(9600);
}

void both(int duty) {
  digitalWrite(IN1, duty > 0);
  digitalWrite(IN2, LOW);
  digitalWrite(IN3, duty > 0);
  digitalWrite(IN4, LOW);
  analogWrite(ENA, duty);
  analogWrite(ENB, duty);
}

void loop() {
  if (Serial.available()) {
    char c = Serial.read();
    if (c == 'F') both(200);
    if (c == 'S') both(0);
  }
  Serial.println(millis());
  delay(200);  // not so fast
}

// A planted fault: IN3 and IN4 are exchanged, so the right wheel turns backward when it should go forward.
#define ENA 5
#define IN1 7
#define IN2 8
#define ENB 6
#define IN3 10
#define IN4 9

void setup() {
  int outputs[] = {ENA, IN1, IN2, ENB, IN3, IN4};
  for (int i = 0; i < 6; i++) pinMode(outputs[i], OUTPUT);
  Serial.begin(9600);
}

void goForward() {
  digitalWrite(IN1, HIGH);
  digitalWrite(IN2, LOW);
  digitalWrite(IN3, HIGH);
  digitalWrite(IN4, LOW);
  analogWrite(ENA, 200);
  analogWrite(ENB, 200);
}

void stopMotors() {
  analogWrite(ENA, 0);
  analogWrite(ENB, 0);
}

void loop() {
  int c = Serial.read();
  if (c == 'F') goForward();
  if (c == 'S') stopMotors();
}

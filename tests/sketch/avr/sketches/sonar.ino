// A sonar that is polled, and answered by a number; a pin shows what is near.
const int TRIG = 12, ECHO = 11, NEAR = 8;
float distance = 0;

float ping() {
  digitalWrite(TRIG, LOW);
  delayMicroseconds(2);
  digitalWrite(TRIG, HIGH);
  delayMicroseconds(10);
  digitalWrite(TRIG, LOW);
  long width = pulseIn(ECHO, HIGH, 30000);
  return width * 0.0343 / 2;
}

void setup() {
  Serial.begin(9600);
  pinMode(TRIG, OUTPUT);
  pinMode(ECHO, INPUT);
  pinMode(NEAR, OUTPUT);
}

void loop() {
  if (Serial.available() > 0) {
    char what = Serial.read();
    if (what == 'p') {
      distance = ping();
      digitalWrite(NEAR, distance < 60 ? HIGH : LOW);
      Serial.println(distance);
    } else if (what == 'i') {
      Serial.print((int)ping());
      Serial.print(' ');
      digitalWrite(NEAR, LOW);
    }
  }
}

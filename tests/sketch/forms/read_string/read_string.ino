// Lines from the laptop by readStringUntil: "fwd 120", "turn -90", "stop", "dist".
#include <NewPing.h>
NewPing front(12, 11, 200);

const int ENA = 5, IN1 = 7, IN2 = 8, ENB = 6, IN3 = 9, IN4 = 10;
unsigned long until = 0;

void setup() {
  Serial.begin(9600);
  Serial.setTimeout(50);
  int outputs[] = {ENA, IN1, IN2, ENB, IN3, IN4};
  for (unsigned int i = 0; i < sizeof(outputs) / sizeof(outputs[0]); i++) pinMode(outputs[i], OUTPUT);
}

void drive(int left, int right) {
  digitalWrite(IN1, left >= 0); digitalWrite(IN2, left < 0); analogWrite(ENA, abs(left));
  digitalWrite(IN3, right >= 0); digitalWrite(IN4, right < 0); analogWrite(ENB, abs(right));
}

void loop() {
  if (Serial.available() > 0) {
    String line = Serial.readStringUntil('\n');
    line.trim();
    int space = line.indexOf(' ');
    String word = space < 0 ? line : line.substring(0, space);
    int value = space < 0 ? 0 : line.substring(space + 1).toInt();
    word.toLowerCase();
    if (word == "fwd") { drive(value, value); until = millis() + 500; }
    else if (word == "turn") { drive(value < 0 ? 90 : -90, value < 0 ? -90 : 90); until = millis() + abs(value) * 3L; }
    else if (word == "stop") { drive(0, 0); until = 0; }
    else if (word == "dist") { Serial.println(String("d=") + front.ping_cm()); return; }
    else { Serial.println("? " + line); return; }
    Serial.println("ok " + word + " " + String(value));
  }
  if (until && millis() > until) { until = 0; drive(0, 0); }
}

// The Arduino Motor Shield R3: direction, PWM and brake of channels A and B.
#define DIR_A 12
#define BRAKE_A 9
#define PWM_A 3
#define DIR_B 13
#define BRAKE_B 8
#define PWM_B 11

void setup() {
  pinMode(DIR_A, OUTPUT);
  pinMode(BRAKE_A, OUTPUT);
  pinMode(DIR_B, OUTPUT);
  pinMode(BRAKE_B, OUTPUT);
  Serial.begin(9600);
}

void moveForward(int duty) {
  digitalWrite(DIR_A, HIGH);
  digitalWrite(BRAKE_A, LOW);
  analogWrite(PWM_A, duty);
  digitalWrite(DIR_B, HIGH);
  digitalWrite(BRAKE_B, LOW);
  analogWrite(PWM_B, duty);
}

void brakeNow() {
  digitalWrite(BRAKE_A, HIGH);
  digitalWrite(BRAKE_B, HIGH);
}

void loop() {
  for (int duty = 90; duty <= 250; duty += 40) {
    moveForward(duty);
    delay(150);
    brakeNow();
    delay(250);
    Serial.print("duty ");
    Serial.println(duty);
  }
  digitalWrite(DIR_A, LOW);
  digitalWrite(DIR_B, LOW);
  digitalWrite(BRAKE_A, LOW);
  digitalWrite(BRAKE_B, LOW);
  analogWrite(PWM_A, 200);
  analogWrite(PWM_B, 200);
  delay(500);
  brakeNow();
  delay(500);
}

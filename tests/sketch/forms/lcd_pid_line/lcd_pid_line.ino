// A line follower with a PID controller, which shows its reading on a display.
#include <LiquidCrystal.h>
#include <PID_v1.h>

LiquidCrystal lcd(12, 11, 5, 4, 3, 2);
double reading, correction, wanted = 480;
PID pid(&reading, &correction, &wanted, 0.12, 0.05, 0.01, DIRECT);
byte arrow[8] = {4, 14, 31, 4, 4, 4, 4, 0};

void wheel(int en, int in1, int in2, int duty) {
  digitalWrite(in1, duty >= 0);
  digitalWrite(in2, duty < 0);
  analogWrite(en, constrain(abs(duty), 0, 255));
}

void setup() {
  for (int pin = 6; pin <= 10; pin++) pinMode(pin, OUTPUT);
  pinMode(13, OUTPUT);
  lcd.begin(16, 2);
  lcd.createChar(0, arrow);
  lcd.setCursor(0, 0);
  lcd.write(byte(0));
  lcd.print(" line follower");
  pid.SetOutputLimits(-80, 80);
  pid.SetSampleTime(20);
  pid.SetMode(AUTOMATIC);
}

void loop() {
  reading = analogRead(A2);
  if (pid.Compute()) {
    wheel(6, 7, 8, 120 - correction);
    wheel(9, 10, 13, 120 + correction);
  }
  static unsigned long shown = 0;
  if (millis() - shown >= 250) {
    shown = millis();
    lcd.setCursor(0, 1);
    lcd.print(reading, 0);
    lcd.print("  ");
    lcd.print(correction, 1);
    lcd.print("     ");
  }
}

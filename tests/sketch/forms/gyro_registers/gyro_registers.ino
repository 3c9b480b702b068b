// Turns left by 90 degrees: the MPU6050's registers by Wire alone, its rate summed up.
#include <Wire.h>
const int MPU = 0x68;
const int leftForward = 5, leftBack = 6, rightForward = 9, rightBack = 10;
float offset = 0, angle = 0;
unsigned long before;
bool done = false;

int readWord(byte reg) {
  Wire.beginTransmission(MPU);
  Wire.write(reg);
  Wire.endTransmission(false);
  Wire.requestFrom(MPU, 2, true);
  return Wire.read() << 8 | Wire.read();
}

void setRegister(byte reg, byte value) {
  Wire.beginTransmission(MPU);
  Wire.write(reg);
  Wire.write(value);
  if (Wire.endTransmission() != 0) Serial.println("no answer");
}

void spinLeft(int duty) {
  analogWrite(leftForward, 0);
  analogWrite(leftBack, duty);
  analogWrite(rightForward, duty);
  analogWrite(rightBack, 0);
}

void setup() {
  Serial.begin(9600);
  Wire.begin();
  Wire.setClock(400000);
  Wire.beginTransmission(0x50);
  Serial.println(Wire.endTransmission());
  Wire.beginTransmission(MPU);
  Wire.write(0x75);
  Wire.endTransmission(false);
  Wire.requestFrom(MPU, 1);
  Serial.println(Wire.read(), HEX);
  setRegister(0x6B, 0);
  setRegister(0x1B, 0x08);
  long sum = 0;
  for (int i = 0; i < 200; i++) {
    sum += readWord(0x47);
    delay(2);
  }
  offset = sum / 200.0;
  Wire.beginTransmission(MPU);
  Wire.write(0x3B);
  Wire.endTransmission(false);
  Wire.requestFrom(MPU, 14, true);
  int values[7];
  for (int i = 0; i < 7; i++) values[i] = Wire.read() << 8 | Wire.read();
  Serial.print(values[2]);
  Serial.print(' ');
  Serial.println(values[3] / 340.0 + 36.53);
  spinLeft(90);
  before = micros();
}

void loop() {
  if (done) return;
  float rate = (readWord(0x47) - offset) / 65.5;
  unsigned long now = micros();
  angle += rate * (now - before) / 1e6;
  before = now;
  if (angle >= 90) {
    spinLeft(0);
    done = true;
    Serial.print("turned ");
    Serial.println(angle);
  }
}

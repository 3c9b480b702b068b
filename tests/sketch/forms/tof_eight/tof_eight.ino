// Eight VL53L0X on one bus, told apart by their XSHUT pins; Pololu's library.
#include <Wire.h>
#include <VL53L0X.h>

const int COUNT = 8;
const uint8_t xshutPins[COUNT] = {22, 24, 26, 28, 30, 32, 34, 36};
const uint8_t FIRST_ADDRESS = 0x30;
VL53L0X sensors[COUNT];

void setup() {
  Serial.begin(115200);
  Wire.begin();
  Wire.setClock(400000);
  for (int i = 0; i < COUNT; i++) {
    pinMode(xshutPins[i], OUTPUT);
    digitalWrite(xshutPins[i], LOW);
  }
  delay(10);
  for (int i = 0; i < COUNT; i++) {
    pinMode(xshutPins[i], INPUT);
    delay(10);
    sensors[i].setTimeout(500);
    if (!sensors[i].init()) {
      Serial.print("no sensor ");
      Serial.println(i);
      while (1);
    }
    sensors[i].setAddress(FIRST_ADDRESS + i);
    sensors[i].setMeasurementTimingBudget(50000);
    sensors[i].startContinuous();
  }
}

void loop() {
  unsigned long begin = millis();
  for (int i = 0; i < COUNT; i++) {
    Serial.print(sensors[i].readRangeContinuousMillimeters());
    if (sensors[i].timeoutOccurred()) Serial.print(" TIMEOUT");
    Serial.print(i < COUNT - 1 ? ',' : ' ');
  }
  Serial.println(millis() - begin);
  delay(200);
}

// Drives ahead until a VL53L0X sees a wall at 150 mm; Adafruit's library.
#include "Adafruit_VL53L0X.h"

Adafruit_VL53L0X lox = Adafruit_VL53L0X();
int seen = 0;

void ahead(int duty) {
  analogWrite(5, duty);
  analogWrite(6, 0);
  analogWrite(9, duty);
  analogWrite(10, 0);
}

void setup() {
  Serial.begin(115200);
  while (!Serial) {
    delay(1);
  }
  Serial.println("VL53L0X test");
  if (!lox.begin()) {
    Serial.println(F("Failed to boot VL53L0X"));
    while (1);
  }
  ahead(120);
}

void loop() {
  VL53L0X_RangingMeasurementData_t measure;
  unsigned long begin = millis();
  lox.rangingTest(&measure, false);
  unsigned long took = millis() - begin;
  if (measure.RangeStatus != 4) {
    if (seen++ % 10 == 0) {
      Serial.print(measure.RangeMilliMeter);
      Serial.print(" mm in ");
      Serial.println(took);
    }
    if (measure.RangeMilliMeter < 150) {
      ahead(0);
    }
  } else {
    Serial.println("out of range");
  }
}

// Remote drive by Bluetooth: a letter a command, and a distance on request.
#include "BluetoothSerial.h"
#include <ESP32Servo.h>

#if !defined(CONFIG_BT_ENABLED) || !defined(CONFIG_BLUEDROID_ENABLED)
#error Bluetooth is not enabled! Please run `make menuconfig` to and enable it
#endif

BluetoothSerial SerialBT;
Servo gripper;

const int ENA = 14, IN1 = 27, IN2 = 26;
const int ENB = 32, IN3 = 25, IN4 = 33;
const int trigPin = 5, echoPin = 18, servoPin = 13, linePin = 34;

const int freq = 30000;
const int pwmChannelA = 4;
const int pwmChannelB = 5;
const int resolution = 10;
int dutyCycle = 700;

void motors(int left, int right) {
  digitalWrite(IN1, left > 0);
  digitalWrite(IN2, left < 0);
  digitalWrite(IN3, right > 0);
  digitalWrite(IN4, right < 0);
  ledcWrite(pwmChannelA, abs(left));
  ledcWrite(pwmChannelB, abs(right));
}

float distanceCm() {
  digitalWrite(trigPin, LOW);
  delayMicroseconds(2);
  digitalWrite(trigPin, HIGH);
  delayMicroseconds(10);
  digitalWrite(trigPin, LOW);
  long duration = pulseIn(echoPin, HIGH);
  return duration * 0.034 / 2;
}

void setup() {
  Serial.begin(115200);
  SerialBT.begin("Rover");
  Serial.println("The device started, now you can pair it with bluetooth!");
  pinMode(IN1, OUTPUT);
  pinMode(IN2, OUTPUT);
  pinMode(IN3, OUTPUT);
  pinMode(IN4, OUTPUT);
  pinMode(trigPin, OUTPUT);
  pinMode(echoPin, INPUT);
  ledcSetup(pwmChannelA, freq, resolution);
  ledcSetup(pwmChannelB, freq, resolution);
  ledcAttachPin(ENA, pwmChannelA);
  ledcAttachPin(ENB, pwmChannelB);
  gripper.setPeriodHertz(50);
  gripper.attach(servoPin, 500, 2400);
  gripper.write(20);
}

void loop() {
  if (!SerialBT.available()) {
    delay(10);
    return;
  }
  char c = SerialBT.read();
  switch (c) {
    case 'F': motors(dutyCycle, dutyCycle); break;
    case 'B': motors(-dutyCycle, -dutyCycle); break;
    case 'L': motors(-dutyCycle, dutyCycle); break;
    case 'R': motors(dutyCycle, -dutyCycle); break;
    case 'S': motors(0, 0); break;
    case 'G': gripper.write(95); break;
    case 'U':
      SerialBT.printf("%.1f cm, line %d\n", distanceCm(), analogRead(linePin));
      return;
    default:
      if (c >= '0' && c <= '9') dutyCycle = 1023 - ('9' - c) * 60;
      else return;
  }
  SerialBT.print(c);
  SerialBT.println(dutyCycle);
}

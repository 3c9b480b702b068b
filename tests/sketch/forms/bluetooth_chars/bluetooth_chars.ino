// Single letters over a Bluetooth module on SoftwareSerial; notes go to the USB port.
#include <SoftwareSerial.h>
SoftwareSerial BT(10, 11);  // RX, TX

#define MOTOR_A_EN 5
#define MOTOR_A_1 2
#define MOTOR_A_2 4
#define MOTOR_B_EN 6
#define MOTOR_B_1 7
#define MOTOR_B_2 8
char c;
int speedNow = 160;

void setup() {
  Serial.begin(9600);
  BT.begin(9600);
  pinMode(MOTOR_A_EN, OUTPUT); pinMode(MOTOR_A_1, OUTPUT); pinMode(MOTOR_A_2, OUTPUT);
  pinMode(MOTOR_B_EN, OUTPUT); pinMode(MOTOR_B_1, OUTPUT); pinMode(MOTOR_B_2, OUTPUT);
  BT.println("hello");
}

void motors(int a1, int a2, int b1, int b2) {
  digitalWrite(MOTOR_A_1, a1);
  digitalWrite(MOTOR_A_2, a2);
  digitalWrite(MOTOR_B_1, b1);
  digitalWrite(MOTOR_B_2, b2);
  analogWrite(MOTOR_A_EN, speedNow);
  analogWrite(MOTOR_B_EN, speedNow);
}

void loop() {
  if (BT.available()) {
    c = BT.read();
    Serial.write(c);
    if (c == 'F') motors(1, 0, 1, 0);
    else if (c == 'B') motors(0, 1, 0, 1);
    else if (c == 'L') motors(0, 1, 1, 0);
    else if (c == 'R') motors(1, 0, 0, 1);
    else if (c == 'S') motors(0, 0, 0, 0);
    else if (c >= '0' && c <= '9') speedNow = map(c - '0', 0, 9, 80, 255);
    BT.print(c);
    BT.print(',');
    BT.println(speedNow, DEC);
  }
}

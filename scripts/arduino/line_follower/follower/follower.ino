// Follows a black line, and stops after a distance: two line sensors, two encoders, an L298N, and a Bluetooth
// module on SoftwareSerial.
//
//   g 30   follow the line for 30 inches, then answer "done" with the ticks of both wheels
//   s      stop
//
// There is a bug in it: the robot goes too far. The page "Your sketch in the simulator" finds it.
#include <SoftwareSerial.h>

SoftwareSerial bluetooth(10, 11);  // RX, TX

const byte LEFT_ENCODER = 2, RIGHT_ENCODER = 3;
const byte LEFT_EN = 5, LEFT_IN1 = 7, LEFT_IN2 = 8;
const byte RIGHT_EN = 6, RIGHT_IN1 = 9, RIGHT_IN2 = 12;
const byte LEFT_LINE = A0, RIGHT_LINE = A1;  // HIGH over the line

const int TICKS_PER_INCH = 20;
const int CRUISE = 150, TURN = 110;

volatile long leftTicks = 0, rightTicks = 0;
long goal = 0;  // ticks; 0 while it stands

void leftEdge() {
  leftTicks++;
  if (leftTicks % 40 == 0) {  // progress, every two inches
    bluetooth.print("at ");
    bluetooth.print(leftTicks / TICKS_PER_INCH);
    bluetooth.print(" in, right wheel ");
    bluetooth.println(rightTicks);
  }
}

void rightEdge() { rightTicks++; }

void wheel(byte en, byte in1, byte in2, int duty) {
  digitalWrite(in1, duty > 0);
  digitalWrite(in2, duty < 0);
  analogWrite(en, abs(duty));
}

void drive(int left, int right) {
  wheel(LEFT_EN, LEFT_IN1, LEFT_IN2, left);
  wheel(RIGHT_EN, RIGHT_IN1, RIGHT_IN2, right);
}

long travelled() {
  noInterrupts();
  long ticks = (leftTicks + rightTicks) / 2;
  interrupts();
  return ticks;
}

void setup() {
  bluetooth.begin(9600);
  const byte outputs[] = {LEFT_EN, LEFT_IN1, LEFT_IN2, RIGHT_EN, RIGHT_IN1, RIGHT_IN2};
  for (byte pin : outputs) pinMode(pin, OUTPUT);
  pinMode(LEFT_ENCODER, INPUT_PULLUP);
  pinMode(RIGHT_ENCODER, INPUT_PULLUP);
  attachInterrupt(digitalPinToInterrupt(LEFT_ENCODER), leftEdge, CHANGE);
  attachInterrupt(digitalPinToInterrupt(RIGHT_ENCODER), rightEdge, CHANGE);
}

void loop() {
  if (bluetooth.available()) {
    char command = bluetooth.read();
    if (command == 'g') {
      goal = bluetooth.parseInt() * (long)TICKS_PER_INCH;
      leftTicks = rightTicks = 0;
    } else if (command == 's') {
      goal = 0;
      drive(0, 0);
    }
  }
  if (goal == 0) return;
  if (travelled() >= goal) {
    goal = 0;
    drive(0, 0);
    bluetooth.print("done ");
    bluetooth.print(leftTicks);
    bluetooth.print(' ');
    bluetooth.println(rightTicks);
    return;
  }
  bool left = digitalRead(LEFT_LINE) == HIGH;
  bool right = digitalRead(RIGHT_LINE) == HIGH;
  if (left && !right) drive(-TURN, TURN);
  else if (right && !left) drive(TURN, -TURN);
  else drive(CRUISE, CRUISE);
  delay(10);
}

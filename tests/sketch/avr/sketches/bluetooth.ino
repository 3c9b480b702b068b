// A module at SoftwareSerial, and an encoder that goes on meanwhile.
#include <SoftwareSerial.h>
SoftwareSerial link(10, 11);
volatile long edges = 0;

void edge() { edges++; }

void setup() {
  link.begin(9600);
  pinMode(8, OUTPUT);
  attachInterrupt(digitalPinToInterrupt(2), edge, CHANGE);
}

void loop() {
  if (link.available() == 0) return;
  char what = link.read();
  if (what == 'H') digitalWrite(8, HIGH);
  if (what == 'L') digitalWrite(8, LOW);
  if (what == '?') link.print("ok");
}

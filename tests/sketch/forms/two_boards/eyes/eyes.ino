// The first board: talks to the laptop, measures, and passes drive commands on to the second.
#include <SoftwareSerial.h>
#include <NewPing.h>
#define STOP_CM 12
SoftwareSerial rover(A1, A0);  // RX, TX
NewPing ahead(8, 4, 200);
String text = "";
bool moving = false;

void setup() {
  Serial.begin(9600);
  rover.begin(9600);
}

void loop() {
  while (Serial.available()) {
    char c = Serial.read();
    if (c != '\n') { text += c; continue; }
    rover.println(text);
    moving = text.startsWith("F");
    text = "";
  }
  while (rover.available()) Serial.write(rover.read());
  if (moving) {
    unsigned int cm = ahead.ping_cm();
    if (cm > 0 && cm < STOP_CM) {
      rover.println("S");
      moving = false;
      Serial.print("wall at ");
      Serial.println(cm);
    }
  }
}

// Waits for the port, runs once, and then stays in an endless loop.
int starts;

void halt() {
  Serial.println("halted");
  Serial.flush();
  while (1);
}

void setup() {
  Serial.begin(38400);
  while (!Serial) {
    ; // wait for the port
  }
  pinMode(13, OUTPUT);
  for (starts = 0; ; starts++) {
    if (starts == 1000) break;
  }
  Serial.println(starts);
}

void loop() {
  digitalWrite(13, !digitalRead(13));
  delay(100);
  if (millis() > 1000) halt();
}

// The echo of a sonar by interrupt: loop() is free while the sound travels.
const byte TRIG_PIN = 7;
const byte ECHO_PIN = 3;
volatile unsigned long echoStart = 0;
volatile unsigned long echoTime = 0;
volatile bool fresh = false;
unsigned long lastPing = 0;
unsigned long passes = 0;

void echoChanged() {
  if (digitalRead(ECHO_PIN) == HIGH) echoStart = micros();
  else { echoTime = micros() - echoStart; fresh = true; }
}

void setup() {
  Serial.begin(19200);
  pinMode(TRIG_PIN, OUTPUT);
  pinMode(ECHO_PIN, INPUT);
  attachInterrupt(digitalPinToInterrupt(ECHO_PIN), echoChanged, CHANGE);
}

void loop() {
  passes++;
  if (millis() - lastPing > 50) {
    lastPing = millis();
    digitalWrite(TRIG_PIN, HIGH);
    delayMicroseconds(10);
    digitalWrite(TRIG_PIN, LOW);
  }
  if (fresh) {
    noInterrupts();
    unsigned long t = echoTime;
    fresh = false;
    interrupts();
    char text[32];
    sprintf(text, "%lu us, %lu passes", t, passes);
    Serial.println(text);
    passes = 0;
  }
}

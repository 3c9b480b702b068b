// A robot with a language of its own: lines in, lines out. dialect.toml beside it says the same to the simulator.
//   get     12.3,45.6   distances ahead and ahead to the left, cm; -1.0 without an echo
//   f 20    ok          ahead, cm; back if it is negative
//   t 90    ok          to the left, degrees; to the right if it is negative
//   x                   stops; the movement under way says "stopped" instead of "ok"

const float CM_PER_S = 15, DEGREES_PER_S = 90;  // measure yours
const byte TRIGGER[] = {2, 4}, ECHO[] = {3, 5};

char line[16];
byte used = 0;
bool moving = false;
unsigned long begun, duration;  // ms

void setup() {
  Serial.begin(9600);
  for (byte i = 0; i < 2; i++) {
    pinMode(TRIGGER[i], OUTPUT);
    pinMode(ECHO[i], INPUT);
  }
  pinMode(LED_BUILTIN, OUTPUT);
}

void loop() {  // never waits: a stop is read while the robot drives
  if (moving && millis() - begun >= duration) finish("ok");
  if (Serial.available() == 0) return;
  char c = Serial.read();
  if (c == '\n') {
    line[used] = '\0';
    used = 0;
    obey(atof(line + 1));
  } else if (used < sizeof(line) - 1) {
    line[used++] = c;
  }
}

void obey(float value) {
  if (strcmp(line, "get") == 0) {
    Serial.print(distance(0), 1);
    Serial.print(',');
    Serial.print(distance(1), 1);
    Serial.print("\r\n");
    return;
  }
  if (moving) finish("stopped");  // any other message ends a movement
  if (strncmp(line, "f ", 2) == 0) start(value, CM_PER_S);
  if (strncmp(line, "t ", 2) == 0) start(value, DEGREES_PER_S);
}

void start(float value, float speed) {
  digitalWrite(LED_BUILTIN, HIGH);  // your motors start here, the other way round if value < 0
  begun = millis();
  duration = fabs(value) / speed * 1000;
  moving = true;
}

void finish(const char *word) {
  digitalWrite(LED_BUILTIN, LOW);  // your motors stop here
  moving = false;
  Serial.print(word);
  Serial.print("\r\n");
}

float distance(byte i) {
  digitalWrite(TRIGGER[i], HIGH);
  delayMicroseconds(10);
  digitalWrite(TRIGGER[i], LOW);
  unsigned long echo = pulseIn(ECHO[i], HIGH, 25000);  // microseconds there and back
  return echo == 0 ? -1 : echo / 58.2;
}

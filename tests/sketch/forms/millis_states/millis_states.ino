// A state machine on millis(): nothing waits, two things happen at their own pace.
#define LED LED_BUILTIN
#define EN_LEFT 5
#define EN_RIGHT 6
const byte LEFT_PINS[] = {2, 4};
const byte RIGHT_PINS[] = {7, 8};

enum State { REST, FORWARD, TURN };
State state = REST;
unsigned long entered = 0;
unsigned long lastBlink = 0;
unsigned long lastReport = 0;
bool lamp = false;

void wheel(const byte pins[], byte en, int speed) {
  digitalWrite(pins[0], speed > 0 ? HIGH : LOW);
  digitalWrite(pins[1], speed < 0 ? HIGH : LOW);
  analogWrite(en, constrain(abs(speed), 0, 255));
}

void enter(State next) {
  state = next;
  entered = millis();
  switch (state) {
    case REST: wheel(LEFT_PINS, EN_LEFT, 0); wheel(RIGHT_PINS, EN_RIGHT, 0); break;
    case FORWARD: wheel(LEFT_PINS, EN_LEFT, 140); wheel(RIGHT_PINS, EN_RIGHT, 140); break;
    case TURN: wheel(LEFT_PINS, EN_LEFT, -110); wheel(RIGHT_PINS, EN_RIGHT, 110); break;
  }
}

void setup() {
  Serial.begin(115200);
  pinMode(LED, OUTPUT);
  for (byte i = 0; i < 2; i++) {
    pinMode(LEFT_PINS[i], OUTPUT);
    pinMode(RIGHT_PINS[i], OUTPUT);
  }
  pinMode(EN_LEFT, OUTPUT);
  pinMode(EN_RIGHT, OUTPUT);
  Serial.println(F("ready"));
}

void loop() {
  unsigned long now = millis();
  if (now - lastBlink >= 250) {
    lastBlink += 250;
    lamp = !lamp;
    digitalWrite(LED, lamp);
  }
  if (now - lastReport >= 500) {
    lastReport = now;
    Serial.print(now / 1000.0, 2);
    Serial.print('\t');
    Serial.println(state);
  }
  unsigned long stay = now - entered;
  if (state == REST && stay > 300) enter(FORWARD);
  else if (state == FORWARD && stay > 600) enter(TURN);
  else if (state == TURN && stay > 250) enter(REST);
}

// Binary frames: 0xAA, command, value, checksum; the answer is a struct, written as it lies in memory.
struct Telemetry {
  uint8_t head;
  int16_t left;
  int16_t right;
  uint32_t time;
} __attribute__((packed));

const uint8_t PWM_L = 3, DIR_L = 2, PWM_R = 11, DIR_R = 4;
uint8_t frame[4];
uint8_t filled = 0;
int16_t left = 0, right = 0;

void apply() {
  digitalWrite(DIR_L, left < 0 ? LOW : HIGH);
  analogWrite(PWM_L, abs(left));
  digitalWrite(DIR_R, right < 0 ? LOW : HIGH);
  analogWrite(PWM_R, abs(right));
}

void handle(uint8_t command, int8_t value) {
  switch (command) {
    case 'L': left = value * 2; apply(); break;
    case 'R': right = value * 2; apply(); break;
    case 'T': {
      Telemetry t = {0x55, left, right, millis()};
      Serial.write((uint8_t *)&t, sizeof(t));
      break;
    }
    default: Serial.write(0xEE);
  }
}

void setup() {
  Serial.begin(57600);
  pinMode(PWM_L, OUTPUT); pinMode(DIR_L, OUTPUT); pinMode(PWM_R, OUTPUT); pinMode(DIR_R, OUTPUT);
}

void loop() {
  while (Serial.available()) {
    uint8_t b = Serial.read();
    if (filled == 0 && b != 0xAA) continue;
    frame[filled++] = b;
    if (filled == 4) {
      filled = 0;
      if ((uint8_t)(frame[0] + frame[1] + frame[2]) == frame[3]) handle(frame[1], (int8_t)frame[2]);
      else Serial.write((uint8_t)0xFF);
    }
  }
}

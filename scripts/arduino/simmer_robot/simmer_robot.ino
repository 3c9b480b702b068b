// The robot's end of the serial port, for SimMeR-TUI's --serial.
//
// A command is a code of two characters, any third character, and perhaps a value, ended by a newline:
// "u1\n" reads a sensor, "d1-3.5\n" drives. Commands in brackets, "[u1,d1:3.5]", need no newline.
// Every command gets exactly one reply, in the form chosen by REPLY:
//   a reading    the sensor's value
//   a drive      infinity, once the robot has done it
//   a mistake    not a number
// Replace readSensor, drive and stopMotors by what your robot has; the rest can stay as it is.

#define TEXT 0     // 12.345 and a newline:      simmer-tui --serial PORT --robot-reply text
#define FLOAT32 1  // 4 bytes, lowest first:     simmer-tui --serial PORT --robot-reply float32
#define FLOAT64 2  // 8 bytes, highest first:    simmer-tui --serial PORT
#define REPLY TEXT

const long BAUD = 9600;
const unsigned long IDLE_TIMEOUT = 50;  // ms; a command that stays without a newline so long is whole

char command[24];  // the command that is coming in
byte length = 0;
bool tooLong = false;
bool inBrackets = false;
bool firstItem = true;
unsigned long lastByte = 0;

// ---- your robot -------------------------------------------------------------------------------

// The value of a sensor. Sets known to false if there is no sensor with this code.
float readSensor(const char *code, bool &known) {
  if (strcmp(code, "u1") == 0) return analogRead(A0) * (36.0 / 1023);  // inches
  if (strcmp(code, "i1") == 0) return analogRead(A1) > 512 ? 1 : 0;
  known = false;
  return NAN;
}

// Drive by a distance in inches or turn by an angle in degrees, and come back when it is done.
// Returns false if there is no drive with this code. Calls stopWanted often, and gives up if it says so.
bool drive(const char *code, float value) {
  if (strcmp(code, "d1") != 0 && strcmp(code, "r1") != 0) return false;
  unsigned long duration = fabs(value) * 100;  // ms
  unsigned long start = millis();
  digitalWrite(LED_BUILTIN, HIGH);  // your motors start here
  while (millis() - start < duration && !stopWanted()) {
  }
  stopMotors();
  return true;
}

void stopMotors() {
  digitalWrite(LED_BUILTIN, LOW);
}

// ---- the contract -----------------------------------------------------------------------------

void setup() {
  pinMode(LED_BUILTIN, OUTPUT);
  Serial.begin(BAUD);
}

void loop() {
  while (Serial.available() > 0) {
    take(Serial.read());
    lastByte = millis();
  }
  if (length > 0 && !inBrackets && millis() - lastByte > IDLE_TIMEOUT) endCommand();
}

// Whether a stop, "xx", waits while the robot drives. It stays there and is answered afterwards.
bool stopWanted() {
  int next = Serial.peek();
  if (next == '\r' || next == '\n') Serial.read();
  return next == 'x' || next == '[';  // nothing else comes before the drive has been answered
}

void take(char c) {
  if (c == '[') {
    length = 0;
    tooLong = false;
    inBrackets = true;
    firstItem = true;
  } else if (inBrackets && (c == ',' || c == ']')) {
    Serial.print(firstItem ? '[' : ',');
    firstItem = false;
    endCommand();
    if (c == ']') {
      Serial.print(']');
      inBrackets = false;
    }
  } else if (!inBrackets && (c == '\n' || c == '\r')) {
    if (length > 0) endCommand();
  } else if (length < sizeof(command) - 1) {
    command[length++] = c;
  } else {
    tooLong = true;
  }
}

void endCommand() {
  command[length] = '\0';
  bool valid = length >= 2 && !tooLong;
  length = 0;
  tooLong = false;

  char code[3] = { command[0], command[1], '\0' };
  if (!valid) {
    reply("??", NAN, "Not Found");
    return;
  }
  if (strcmp(code, "xx") == 0) {
    stopMotors();
    reply(code, INFINITY, "DRIVE STOP");
    return;
  }
  bool known = true;
  float reading = readSensor(code, known);
  if (known) {
    reply(code, reading, NULL);
    return;
  }
  char *end = NULL;
  float value = NAN;
  if (strlen(command) > 3) value = strtod(command + 3, &end);
  if (end == NULL || *end != '\0' || isnan(value) || isinf(value)) {
    reply(code, NAN, "False");
  } else if (drive(code, value)) {
    reply(code, INFINITY, "True");
  } else {
    reply(code, NAN, "Not Found");
  }
}

// Answer a command: in brackets with the word if there is one, else with the number.
void reply(const char *code, float number, const char *word) {
  if (inBrackets) {
    Serial.print(code);
    Serial.print(':');
    if (word != NULL) Serial.print(word);
    else printNumber(number);
    return;
  }
#if REPLY == TEXT
  printNumber(number);
  Serial.print('\n');
#elif REPLY == FLOAT32
  Serial.write((const byte *)&number, 4);  // these boards store the lowest byte first
#else
  sendDouble(number);
#endif
}

void printNumber(float number) {
  if (isnan(number)) Serial.print("nan");
  else if (isinf(number)) Serial.print(number > 0 ? "inf" : "-inf");
  else Serial.print(number, 3);
}

// Send a number as a double, highest byte first. An Uno's own double has just 4 bytes, so that the
// sign, the exponent and the fraction are put in their places of an 8-byte double here.
void sendDouble(float number) {
  uint32_t bits;
  memcpy(&bits, &number, 4);
  uint32_t sign = bits & 0x80000000UL;
  uint32_t exponent = (bits >> 23) & 0xFF;
  uint32_t fraction = bits & 0x7FFFFFUL;
  if (exponent == 0xFF) exponent = 0x7FF;        // infinite, or not a number
  else if (exponent == 0) fraction = 0;          // zero, or next to it
  else exponent += 1023 - 127;
  uint32_t high = sign | (exponent << 20) | (fraction >> 3);
  uint32_t low = fraction << 29;
  for (int shift = 24; shift >= 0; shift -= 8) Serial.write((byte)(high >> shift));
  for (int shift = 24; shift >= 0; shift -= 8) Serial.write((byte)(low >> shift));
}

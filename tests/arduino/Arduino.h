// As much of an Arduino as the robot's sketch needs, with standard input and output for its serial port.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include <poll.h>
#include <time.h>
#include <unistd.h>

using std::isinf;
using std::isnan;
typedef uint8_t byte;
enum { A0, A1, LED_BUILTIN, OUTPUT, INPUT, LOW, HIGH };

inline unsigned long millis() {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1000UL + now.tv_nsec / 1000000UL;
}
inline void delay(unsigned long) {}
inline int analogRead(int pin) { return pin == A0 ? 341 : 1000; }
inline void digitalWrite(int, int) {}
inline void pinMode(int, int) {}
inline void delayMicroseconds(int) {}
// An echo from 50 cm, there and back.
inline unsigned long pulseIn(int, int, unsigned long) { return 2910; }

struct SerialPort {
  int waiting = -1;
  void begin(long) {}
  int peek() {
    pollfd input = { 0, POLLIN, 0 };
    if (waiting < 0 && poll(&input, 1, 0) > 0) {
      byte data;
      if (::read(0, &data, 1) != 1) exit(0);
      waiting = data;
    }
    return waiting;
  }
  int available() { return peek() >= 0; }
  int read() {
    int data = peek();
    waiting = -1;
    return data;
  }
  void write(byte data) { write(&data, 1); }
  void write(const byte *data, size_t size) {
    if (::write(1, data, size) < 0) exit(1);
  }
  void print(char c) { write((byte)c); }
  void print(const char *text) { write((const byte *)text, strlen(text)); }
  void print(float number, int digits) {
    char text[40];
    print((snprintf(text, sizeof text, "%.*f", digits, number), text));
  }
} Serial;

// The Arduino IDE declares the functions of a sketch by itself.
void obey(float value);
void start(float value, float speed);
void finish(const char *word);
float distance(byte i);
float readSensor(const char *code, bool &known);
bool drive(const char *code, float value);
void stopMotors();
bool stopWanted();
void take(char c);
void endCommand();
void reply(const char *code, float number, const char *word);
void printNumber(float number);
void sendDouble(float number);

// Servos: the width of their pulses.
#pragma once

class Servo {
 public:
#if defined(SIMMER_ESP32)
  void setPeriodHertz(int) {}
#endif
  unsigned char attach(int pin, int shortest = 544, int longest = 2400);
  void detach();
  void write(int value);               // degrees, or microseconds from 544 on
  void writeMicroseconds(int width);
  int read() const;
  int readMicroseconds() const { return width_; }
  bool attached() const { return pin_ >= 0; }

 private:
  void send() const;
  int pin_ = -1, shortest_ = 544, longest_ = 2400, width_ = 1500;
};

// An L298N as a class: ramps its duty so that the wheels do not slip. On a Nano.
class Motor {
 public:
  Motor(uint8_t en, uint8_t a, uint8_t b) : _en(en), _a(a), _b(b), _duty(0), _goal(0) {}
  void begin() {
    pinMode(_en, OUTPUT);
    pinMode(_a, OUTPUT);
    pinMode(_b, OUTPUT);
  }
  void go(int goal) { _goal = constrain(goal, -255, 255); }
  void update() {
    if (_duty < _goal) _duty += min(5, _goal - _duty);
    if (_duty > _goal) _duty -= min(5, _duty - _goal);
    digitalWrite(_a, _duty > 0);
    digitalWrite(_b, _duty < 0);
    analogWrite(_en, abs(_duty));
  }

 private:
  uint8_t _en, _a, _b;
  int _duty, _goal;
};

Motor left(9, 8, 7), right(10, 12, 13);
unsigned long last;

void setup() {
  left.begin();
  right.begin();
}

void loop() {
  unsigned long t = millis();
  if (t < 1500) { left.go(180); right.go(180); }
  else if (t < 2200) { left.go(-100); right.go(100); }
  else { left.go(0); right.go(0); }
  if (t - last >= 20) {
    last = t;
    left.update();
    right.update();
  }
}

#include "pins.h"

#include "../core/Arduino.h"
#include "exchange.h"
#include "i2c.h"
#include "interrupts.h"
#include "mistakes.h"
#include "tasks.h"

namespace board {

namespace {
struct Pin {
  uint8_t mode, level;  // `level` is the output's
  int32_t duty;         // 1 up to the most, or 0 without PWM
  int8_t outside;       // the world's level; -1 where nothing is connected
  bool drives, triggers, asked, steps;
  bool answer;             // of one that is asked, and `answers_since` for which it is known; 0 for none
  uint64_t answer_since;
};
#if defined(SIMMER_ESP32)
constexpr Told DUTY = Told::FineDuty;
#else
constexpr Told DUTY = Told::Duty;
#endif
Pin pins[PINS];
bool prepared = false;

Pin* pin_of(int number) {
  if (!prepared) {
    for (Pin& each : pins) each.outside = -1;
    prepared = true;
  }
  return number >= 0 && number < PINS ? &pins[number] : nullptr;
}

// Returns true if the level or the duty has changed, and an output has told it.
bool set_output(int number, Pin& pin, int level, int duty) {
  if (pin.level == level && pin.duty == duty) return false;
  const bool falls = pin.level == 1 && level == 0 && pin.duty == 0;
  pin.level = static_cast<uint8_t>(level);
  pin.duty = duty;
  if (pin.mode != OUTPUT) return false;  // the pull-up of an input drives nothing
  parts_see_pin(number, level || duty);
  if (pin.steps && !duty) {
    if (!level) return true;  // the fall of a step does nothing
    tell(Told::Step, number, static_cast<int>(place));
  } else if (duty)
    tell(DUTY, number, duty);
  else
    tell(Told::Level, number, level);
  if (pin.triggers && falls)
    exchange(Reason::Query, Query::Sonar, number);
  else if (pin.drives)
    exchange(Reason::Output);
  return true;
}

// Pins of an ESP32 that cannot do what the sketch wants: those that are inputs alone, and those of its flash memory.
void look_at_use(int number, bool writes, uint32_t at) {
#if defined(SIMMER_ESP32)
  if (number >= 6 && number <= 11) note_mistake(Mistake::FlashPin, at, number);
  if (writes && number >= 0 && number < PINS && !digitalPinCanOutput(number)) note_mistake(Mistake::InputPin, at, number);
#else
  (void)number, (void)writes, (void)at;
#endif
}
}  // namespace

void set_input(int number, int level) {
  Pin* pin = pin_of(number);
  if (!pin) return;
  const int before = input_level(number);
  pin->outside = static_cast<int8_t>(level);
  if (before != level) note_edge(number, level != 0);
}

int input_level(int number) {
  const Pin* pin = pin_of(number);
  if (!pin) return LOW;
  if (pin->outside >= 0) return pin->outside;
  return pin->mode == INPUT_PULLUP ? HIGH : LOW;
}

void mark_driving(int pin) { if (Pin* each = pin_of(pin)) each->drives = true; }
void mark_trigger(int pin) { if (Pin* each = pin_of(pin)) each->triggers = true; }
void mark_stepping(int pin) { if (Pin* each = pin_of(pin)) each->steps = true; }
void mark_asked(int pin) { if (Pin* each = pin_of(pin)) each->asked = true; }

}  // namespace board

using namespace board;

void pinMode(int number, int mode) {
  pass(cost::PIN_MODE);
  Pin* pin = pin_of(number);
  look_at_use(number, mode == OUTPUT, CALLED_AT);
  // As the core: what is neither of the inputs is an output, such as the 7 of pinMode(OUTPUT, 7).
#if defined(SIMMER_ESP32)
  if ((mode == INPUT_PULLUP || mode == INPUT_PULLDOWN) && !digitalPinCanOutput(number))
    note_mistake(Mistake::NoPullUp, CALLED_AT, number);
  if (mode == INPUT_PULLDOWN || !digitalPinCanOutput(number)) mode = INPUT;
#endif
  if (mode != INPUT && mode != INPUT_PULLUP) mode = OUTPUT;
  if (!pin || pin->mode == mode) return;
  pin->mode = static_cast<uint8_t>(mode);
  tell(Told::Mode, number, mode);
  // INPUT after INPUT_PULLUP leaves the output latch low, as the core does.
  if (mode != OUTPUT) {
    pin->level = mode == INPUT_PULLUP;
    pin->duty = 0;
  } else {
    tell(Told::Level, number, pin->level);
  }
  parts_see_pin(number, mode != OUTPUT || pin->level);
  if (pin->drives) exchange(Reason::Output);
}

void digitalWrite(int number, int value) {
  pass(cost::DIGITAL);
  look_at_use(number, true, CALLED_AT);
  if (Pin* pin = pin_of(number)) set_output(number, *pin, value ? 1 : 0, 0);
}

int digitalRead(int number) {
  pass(cost::DIGITAL);
  Pin* pin = pin_of(number);
  if (!pin) return LOW;
  if (pin->asked && pin->mode != OUTPUT) {
    if (pin->answer_since != answers_since) {
      pin->answer = exchange(Reason::Query, Query::Digital, number) != 0.0;
      pin->answer_since = grant_flags & ANSWER_HOLDS ? answers_since : 0;
    }
    return pin->answer;
  }
  return pin->mode == OUTPUT ? pin->level : input_level(number);
}

namespace {
// A duty at a pin, of 8 bits or of more.
void write_duty(int number, int value, int most) {
  pass(cost::ANALOG_WRITE);
  Pin* pin = pin_of(number);
  if (!pin) return;
  // analogWrite makes the pin an output, as the core does.
  const bool was_input = pin->mode != OUTPUT;
  if (was_input) {
    pin->mode = OUTPUT;
    tell(Told::Mode, number, OUTPUT);
    tell(Told::Level, number, pin->level);
    parts_see_pin(number, pin->level);
  }
  // The compare register has 8 bits: 256 is 0, -1 is 255.
  const int duty = value & most;
  bool told = false;
  if (value == 0)
    told = set_output(number, *pin, 0, 0);
  else if (value == most)
    told = set_output(number, *pin, 1, 0);
  else if (digitalPinHasPWM(number))
    told = set_output(number, *pin, duty == most, duty == most ? 0 : duty);
  else
    told = set_output(number, *pin, value > most / 2, 0);  // no timer: the core writes a level
  if (was_input && !told && pin->drives) exchange(Reason::Output);
}
}  // namespace

#if !defined(SIMMER_ESP32)
void analogWrite(int number, int value) { write_duty(number, value, 255); }
#else
namespace {
constexpr int CHANNELS = 16, MOST_BITS = 16, FINEST = 65535;
struct Channel {
  int bits = 8;
  unsigned int duty = 0;
};
Channel channels[CHANNELS];
Channel own_channels[DIGITAL_PINS];  // of pins that have no number of a channel
int8_t channel_of_pin[DIGITAL_PINS]; // 1 up; 0 without one
bool is_attached[DIGITAL_PINS];      // by ledcAttach() or analogWrite()
int analog_bits = 8;

bool is_pin(int pin) { return pin >= 0 && pin < DIGITAL_PINS; }

// The duty as a share of 65,535. All ones are HIGH, as in the core.
void write_channel(int pin, const Channel& channel) {
  if (!digitalPinCanOutput(pin)) return;
  const unsigned int most = (1u << channel.bits) - 1;
  const unsigned int duty = channel.duty < most ? channel.duty : most;
  write_duty(pin, static_cast<int>(static_cast<uint64_t>(duty) * FINEST / most), FINEST);
}
}  // namespace

double ledcSetup(int channel, unsigned int frequency, int bits) {
  pass(cost::PIN_MODE);
  if (channel < 0 || channel >= CHANNELS) return 0;
  channels[channel].bits = constrain(bits, 1, MOST_BITS);
  return frequency;
}
void ledcAttachPin(int pin, int channel) {
  look_at_use(pin, true, CALLED_AT);
  if (!is_pin(pin) || channel < 0 || channel >= CHANNELS) return;
  channel_of_pin[pin] = static_cast<int8_t>(channel + 1);
  write_channel(pin, channels[channel]);
}
void ledcDetachPin(int pin) {
  if (!is_pin(pin)) return;
  channel_of_pin[pin] = 0;
  is_attached[pin] = false;
  write_duty(pin, 0, FINEST);
}
namespace {
bool attach_channel(int pin, int bits) {
  if (!is_pin(pin)) return false;
  is_attached[pin] = true;
  own_channels[pin].bits = constrain(bits, 1, MOST_BITS);
  own_channels[pin].duty = 0;
  write_channel(pin, own_channels[pin]);
  return true;
}
}  // namespace
bool ledcAttach(int pin, unsigned int, int bits) {
  look_at_use(pin, true, CALLED_AT);
  return attach_channel(pin, bits);
}
bool ledcAttachChannel(int pin, unsigned int, int bits, int) {
  look_at_use(pin, true, CALLED_AT);
  return attach_channel(pin, bits);
}
bool ledcDetach(int pin) {
  ledcDetachPin(pin);
  return is_pin(pin);
}
bool ledcWrite(int number, unsigned int duty) {
  if (is_pin(number) && is_attached[number]) {
    own_channels[number].duty = duty;
    write_channel(number, own_channels[number]);
    return true;
  }
  if (number < 0 || number >= CHANNELS) return false;
  channels[number].duty = duty;
  for (int pin = 0; pin < DIGITAL_PINS; ++pin)
    if (channel_of_pin[pin] == number + 1) write_channel(pin, channels[number]);
  return true;
}
unsigned int ledcRead(int number) {
  if (is_pin(number) && is_attached[number]) return own_channels[number].duty;
  return number >= 0 && number < CHANNELS ? channels[number].duty : 0;
}
void analogWriteResolution(int bits) { analog_bits = constrain(bits, 1, MOST_BITS); }
void analogWriteResolution(int pin, int bits) {
  if (is_pin(pin)) own_channels[pin].bits = constrain(bits, 1, MOST_BITS);
}
void analogWriteFrequency(unsigned int) {}
void analogWriteFrequency(int, unsigned int) {}
void analogWrite(int pin, int value) {
  if (!is_pin(pin)) return;
  look_at_use(pin, true, CALLED_AT);
  if (!is_attached[pin]) attach_channel(pin, analog_bits);
  ledcWrite(pin, value < 0 ? 0 : static_cast<unsigned int>(value));
}
#endif

#if defined(SIMMER_ESP32)
namespace {
int read_bits = 12;
// Millivolts that give all ones, by the attenuation.
constexpr double FULL_SCALES[] = {1100, 1500, 2200, 3300};
double full_scales[DIGITAL_PINS];  // 0 is 3.3 V
}  // namespace
void analogReadResolution(int bits) { read_bits = constrain(bits, 1, 16); }
void analogSetAttenuation(adc_attenuation_t attenuation) {
  for (double& each : full_scales) each = FULL_SCALES[attenuation];
}
void analogSetPinAttenuation(int pin, adc_attenuation_t attenuation) {
  if (is_pin(pin)) full_scales[pin] = FULL_SCALES[attenuation];
}
#endif

int analogRead(int number) {
  const int pin = number < FIRST_ANALOG ? number + FIRST_ANALOG : number;
  const double value = exchange(Reason::Query, Query::Analog, pin);
  pass(cost::ANALOG_READ);
#if defined(SIMMER_ESP32)
  const double scale = is_pin(pin) && full_scales[pin] > 0 ? FULL_SCALES[ADC_11db] / full_scales[pin] : 1;
  const int counts = value * scale > 4095 ? 4095 : static_cast<int>(value * scale);
  return read_bits > 12 ? counts << (read_bits - 12) : counts >> (12 - read_bits);
#else
  return static_cast<int>(value);
#endif
}

void analogReference(int) {}

unsigned int pulseIn(int number, int value, unsigned int timeout) {
  const Pin* pin = pin_of(number);
  if (!pin) return 0;
  note_in_interrupt(InterruptCall::Pulse, CALLED_AT);
  const WaitScope scope(Waits::InPulse, CALLED_AT);
  const Nanoseconds limit = now + timeout * MICROSECOND;
  const auto wait = [&](bool level) {
    while ((input_level(number) != 0) != level) {
      if (now >= limit) return false;
      pass_until_event(limit);
    }
    return true;
  };
  if (!wait(!value) || !wait(value)) return 0;
  const Nanoseconds begin = now, away = running_task().away;
  if (!wait(!value)) return 0;
  // An AVR counts its own loops, an ESP32 looks at the clock.
  const Nanoseconds others = CORES == 1 ? running_task().away - away : 0;
  return static_cast<unsigned int>((now - begin - others) / MICROSECOND);
}

void attachInterrupt(int number, void (*function)(), int mode) {
  attach(interrupt_pin(number), InterruptFunction(function), mode);
}
#if defined(SIMMER_ESP32)
void attachInterruptArg(int number, void (*function)(void*), void* argument, int mode) {
  attach(interrupt_pin(number), InterruptFunction(function, argument), mode);
}
#endif
void detachInterrupt(int number) { attach(interrupt_pin(number), InterruptFunction(), 0); }
void interrupts() {
  set_interrupts(true);
  if (!interrupt_waits() && next_task_stop() > now) return;
  const uint64_t before = wakes;
  service();
  if (wakes != before) waited_for_sei = now;
}
void noInterrupts() { set_interrupts(false); }
void sei() { interrupts(); }
void cli() { noInterrupts(); }

StatusRegister SREG;
StatusRegister::operator unsigned char() const { return interrupts_on() ? 0x80 : 0; }
StatusRegister& StatusRegister::operator=(unsigned char value) {
  if (value & 0x80)
    interrupts();
  else
    noInterrupts();
  return *this;
}

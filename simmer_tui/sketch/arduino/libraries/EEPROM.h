// EEPROM: kept as long as the run; empty (0xFF) at its beginning.
#pragma once
#include <cstdint>

uint8_t eeprom_read(int address);
void eeprom_write(int address, uint8_t value);  // 3.3 ms

class EEPROMCell {
 public:
  explicit EEPROMCell(int address) : address_(address) {}
  operator uint8_t() const { return eeprom_read(address_); }
  EEPROMCell& operator=(uint8_t value) {
    eeprom_write(address_, value);
    return *this;
  }

 private:
  int address_;
};

class EEPROMClass {
 public:
  uint8_t read(int address) { return eeprom_read(address); }
  void write(int address, uint8_t value) { eeprom_write(address, value); }
  void update(int address, uint8_t value) {
    if (eeprom_read(address) != value) eeprom_write(address, value);
  }
  EEPROMCell operator[](int address) { return EEPROMCell(address); }
  unsigned int length() const;
  template <class Value>
  Value& get(int address, Value& value) {
    uint8_t* bytes = reinterpret_cast<uint8_t*>(&value);
    for (unsigned int place = 0; place < sizeof value; ++place) bytes[place] = read(address + static_cast<int>(place));
    return value;
  }
  template <class Value>
  const Value& put(int address, const Value& value) {
    const uint8_t* bytes = reinterpret_cast<const uint8_t*>(&value);
    for (unsigned int place = 0; place < sizeof value; ++place) update(address + static_cast<int>(place), bytes[place]);
    return value;
  }
};
extern EEPROMClass EEPROM;

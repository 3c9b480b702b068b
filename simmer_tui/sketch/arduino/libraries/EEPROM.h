// EEPROM: kept as long as the run; empty (0xFF) at its beginning.
#pragma once
#include <cstdint>

#if defined(SIMMER_ESP32)
#include <cstring>
#include <vector>

#include "../core/WString.h"

void flash_write();

// An ESP32 has none: a copy of a part of its flash memory, which commit() writes.
class EEPROMClass {
 public:
  bool begin(size_t size) {
    if (!size || size > E2END + 1) return false;
    cells_.resize(size, 0xFF);
    kept_.resize(size < kept_.size() ? kept_.size() : size, 0xFF);
    std::memcpy(cells_.data(), kept_.data(), size);
    return true;
  }
  bool commit() {
    if (cells_.empty()) return false;
    if (is_changed_) flash_write();
    is_changed_ = false;
    std::memcpy(kept_.data(), cells_.data(), cells_.size());
    return true;
  }
  void end() {
    commit();
    cells_.clear();
  }
  uint16_t length() const { return static_cast<uint16_t>(cells_.size()); }
  uint8_t read(int address) { return has(address, 1) ? cells_[static_cast<size_t>(address)] : 0; }
  void write(int address, uint8_t value) { put(address, value); }
  template <class Value>
  Value& get(int address, Value& value) {
    if (has(address, sizeof value)) std::memcpy(static_cast<void*>(&value), cells_.data() + address, sizeof value);
    return value;
  }
  template <class Value>
  const Value& put(int address, const Value& value) {
    if (has(address, sizeof value)) {
      std::memcpy(cells_.data() + address, static_cast<const void*>(&value), sizeof value);
      is_changed_ = true;
    }
    return value;
  }
  uint8_t readByte(int address) { return read(address); }
  int32_t readInt(int address) { return number<int32_t>(address); }
  uint32_t readUInt(int address) { return number<uint32_t>(address); }
  int32_t readLong(int address) { return number<int32_t>(address); }
  uint32_t readULong(int address) { return number<uint32_t>(address); }
  float readFloat(int address) { return number<float>(address); }
  double readDouble(int address) { return number<double>(address); }
  bool readBool(int address) { return read(address) != 0; }
  String readString(int address) {
    String text;
    for (; has(address, 1) && read(address); ++address) text += static_cast<char>(read(address));
    return text;
  }
  size_t writeByte(int address, uint8_t value) { return given(address, value); }
  size_t writeInt(int address, int32_t value) { return given(address, value); }
  size_t writeUInt(int address, uint32_t value) { return given(address, value); }
  size_t writeLong(int address, int32_t value) { return given(address, value); }
  size_t writeULong(int address, uint32_t value) { return given(address, value); }
  size_t writeFloat(int address, float value) { return given(address, value); }
  size_t writeDouble(int address, double value) { return given(address, value); }
  size_t writeBool(int address, bool value) { return given(address, static_cast<uint8_t>(value)); }
  size_t writeString(int address, const String& text) {
    if (!has(address, text.length() + 1)) return 0;
    std::memcpy(cells_.data() + address, text.c_str(), text.length() + 1);
    is_changed_ = true;
    return text.length();
  }

 private:
  bool has(int address, size_t size) const { return address >= 0 && static_cast<size_t>(address) + size <= cells_.size(); }
  template <class Number>
  Number number(int address) {
    Number value = 0;
    return get(address, value);
  }
  template <class Number>
  size_t given(int address, Number value) {
    put(address, value);
    return has(address, sizeof value) ? sizeof value : 0;
  }
  std::vector<uint8_t> cells_, kept_;
  bool is_changed_ = false;
};
#else
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
#endif
extern EEPROMClass EEPROM;

// Values by name in the flash memory of an ESP32: empty when a run begins, and kept until its end.
#pragma once
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "../core/Arduino.h"

void flash_read();
void flash_write();

class Preferences {
 public:
  Preferences() = default;
  ~Preferences() { end(); }
  Preferences(const Preferences&) = delete;
  Preferences& operator=(const Preferences&) = delete;

  // Without a namespace of this name, one that is only read cannot begin.
  bool begin(const char* name, bool read_only = false, const char* = nullptr) {
    if (values_ || !is_name(name) || (read_only && !spaces().count(name))) return false;
    values_ = &spaces()[name];
    read_only_ = read_only;
    return true;
  }
  void end() { values_ = nullptr; }
  bool clear() {
    if (!can_write()) return false;
    values_->clear();
    return true;
  }
  bool remove(const char* key) { return can_write() && values_->erase(key) > 0; }
  bool isKey(const char* key) { return values_ && values_->count(key) > 0; }
  size_t freeEntries() { return 500; }  // about what an empty partition of 20 kB has: it stays the same

  size_t putChar(const char* key, int8_t value) { return put(key, 'c', value); }
  size_t putUChar(const char* key, uint8_t value) { return put(key, 'C', value); }
  size_t putShort(const char* key, int16_t value) { return put(key, 's', value); }
  size_t putUShort(const char* key, uint16_t value) { return put(key, 'S', value); }
  size_t putInt(const char* key, int32_t value) { return put(key, 'i', value); }
  size_t putUInt(const char* key, uint32_t value) { return put(key, 'I', value); }
  size_t putLong(const char* key, int32_t value) { return put(key, 'i', value); }
  size_t putULong(const char* key, uint32_t value) { return put(key, 'I', value); }
  size_t putLong64(const char* key, int64_t value) { return put(key, 'l', value); }
  size_t putULong64(const char* key, uint64_t value) { return put(key, 'L', value); }
  size_t putFloat(const char* key, float value) { return put(key, 'b', value); }
  size_t putDouble(const char* key, double value) { return put(key, 'b', value); }
  size_t putBool(const char* key, bool value) { return put(key, 'C', static_cast<uint8_t>(value)); }
  size_t putString(const char* key, const char* value) { return set(key, 't', value, std::strlen(value)); }
  size_t putString(const char* key, const String& value) { return putString(key, value.c_str()); }
  size_t putBytes(const char* key, const void* value, size_t length) { return set(key, 'b', value, length); }

  int8_t getChar(const char* key, int8_t other = 0) { return get(key, 'c', other); }
  uint8_t getUChar(const char* key, uint8_t other = 0) { return get(key, 'C', other); }
  int16_t getShort(const char* key, int16_t other = 0) { return get(key, 's', other); }
  uint16_t getUShort(const char* key, uint16_t other = 0) { return get(key, 'S', other); }
  int32_t getInt(const char* key, int32_t other = 0) { return get(key, 'i', other); }
  uint32_t getUInt(const char* key, uint32_t other = 0) { return get(key, 'I', other); }
  int32_t getLong(const char* key, int32_t other = 0) { return get(key, 'i', other); }
  uint32_t getULong(const char* key, uint32_t other = 0) { return get(key, 'I', other); }
  int64_t getLong64(const char* key, int64_t other = 0) { return get(key, 'l', other); }
  uint64_t getULong64(const char* key, uint64_t other = 0) { return get(key, 'L', other); }
  float getFloat(const char* key, float other = NAN) { return get(key, 'b', other); }
  double getDouble(const char* key, double other = NAN) { return get(key, 'b', other); }
  bool getBool(const char* key, bool other = false) { return get(key, 'C', static_cast<uint8_t>(other)) != 0; }
  String getString(const char* key, const String& other = String()) {
    const Value* value = find(key, 't');
    return value ? String(std::string(value->bytes.begin(), value->bytes.end()).c_str()) : other;
  }
  size_t getString(const char* key, char* into, size_t most) {
    const Value* value = find(key, 't');
    if (!value || value->bytes.size() >= most) return 0;
    std::memcpy(into, value->bytes.data(), value->bytes.size());
    into[value->bytes.size()] = 0;
    return value->bytes.size() + 1;
  }
  size_t getBytesLength(const char* key) {
    const Value* value = find(key, 'b');
    return value ? value->bytes.size() : 0;
  }
  size_t getBytes(const char* key, void* into, size_t most) {
    const Value* value = find(key, 'b');
    if (!value || value->bytes.size() > most) return 0;
    std::memcpy(into, value->bytes.data(), value->bytes.size());
    return value->bytes.size();
  }

 private:
  // One that is read as another kind is not found.
  struct Value {
    char kind;
    std::vector<uint8_t> bytes;
  };
  using Space = std::map<std::string, Value>;
  static std::map<std::string, Space>& spaces() {
    static std::map<std::string, Space> made;
    return made;
  }
  // The memory keeps names of 15 characters at most.
  static bool is_name(const char* name) { return name && *name && std::strlen(name) <= 15; }
  bool can_write() const { return values_ && !read_only_; }

  size_t set(const char* key, char kind, const void* value, size_t length) {
    if (!can_write() || !is_name(key)) return 0;
    flash_write();
    const uint8_t* bytes = static_cast<const uint8_t*>(value);
    (*values_)[key] = Value{kind, std::vector<uint8_t>(bytes, bytes + length)};
    return length;
  }
  template <class Number>
  size_t put(const char* key, char kind, Number value) {
    return set(key, kind, &value, sizeof value);
  }
  const Value* find(const char* key, char kind) {
    if (!values_ || !key) return nullptr;
    flash_read();
    const auto found = values_->find(key);
    return found != values_->end() && found->second.kind == kind ? &found->second : nullptr;
  }
  template <class Number>
  Number get(const char* key, char kind, Number other) {
    const Value* value = find(key, kind);
    if (!value || value->bytes.size() != sizeof other) return other;
    std::memcpy(&other, value->bytes.data(), sizeof other);
    return other;
  }

  Space* values_ = nullptr;
  bool read_only_ = false;
};

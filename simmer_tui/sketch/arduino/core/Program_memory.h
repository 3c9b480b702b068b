// PROGMEM: program memory is ordinary memory here.
#pragma once
#include <cstdint>
#include <cstring>
#include <type_traits>

#define PROGMEM
#define PGM_P const char*
#define PGM_VOID_P const void*
#define PSTR(text) (text)

// Functions of the runtime in its headers have no basic blocks of the sketch: their time is that of their calls.
#if defined(__clang__)
#define SIMMER_RUNTIME __attribute__((no_sanitize("coverage"), noinline))
#else
#define SIMMER_RUNTIME __attribute__((no_sanitize_coverage, noinline))
#endif

class __FlashStringHelper;
#define F(text) (reinterpret_cast<const __FlashStringHelper*>(text))
#define FPSTR(text) (reinterpret_cast<const __FlashStringHelper*>(text))

// A pointer in a table is read by pgm_read_word on an AVR: it has two bytes there. Here it stays whole.
template <class Value>
auto pgm_word_at(const Value* address) {
  if constexpr (std::is_pointer<Value>::value)
    return reinterpret_cast<uintptr_t>(*address);
  else
    return *reinterpret_cast<const uint16_t*>(address);
}
// As avr-libc's: whatever the address is the address of.
#define pgm_read_byte(address) (*(const uint8_t*)(address))
#define pgm_read_word(address) pgm_word_at(address)
#define pgm_read_dword(address) (*(const uint32_t*)(address))
#define pgm_read_float(address) (*(const float*)(address))
#define pgm_read_ptr(address) (*(void* const*)(address))
#define pgm_read_byte_near(address) pgm_read_byte(address)
#define pgm_read_word_near(address) pgm_read_word(address)
#define pgm_read_dword_near(address) pgm_read_dword(address)
#define pgm_read_float_near(address) pgm_read_float(address)
#define pgm_read_ptr_near(address) pgm_read_ptr(address)

#define memcpy_P std::memcpy
#define memcmp_P std::memcmp
#define strcpy_P std::strcpy
#define strncpy_P std::strncpy
#define strcat_P std::strcat
#define strcmp_P std::strcmp
#define strncmp_P std::strncmp
#define strlen_P std::strlen
#define strstr_P std::strstr
#define strchr_P std::strchr
#define strrchr_P std::strrchr
#define strcasecmp_P strcasecmp
#define strncasecmp_P strncasecmp
#define strnlen_P strnlen
#define sscanf_P avr_sscanf
#define vsnprintf_P avr_vsnprintf
#define sprintf_P avr_sprintf
#define snprintf_P avr_snprintf

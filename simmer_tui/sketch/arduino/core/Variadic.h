// Arguments of functions of the sketch with `...`: a small number is passed on as an `int` of this machine.
#pragma once
#include <cstdarg>
#include <cstdint>

template <class Type>
struct BoardPassed { using type = Type; };
template <> struct BoardPassed<bool> { using type = int; };
template <> struct BoardPassed<char> { using type = int; };
template <> struct BoardPassed<int8_t> { using type = int; };
template <> struct BoardPassed<uint8_t> { using type = int; };
template <> struct BoardPassed<int16_t> { using type = int; };
template <> struct BoardPassed<uint16_t> { using type = int; };
template <> struct BoardPassed<float> { using type = double; };

#undef va_arg
#define va_arg(list, type_of_value) ((type_of_value)__builtin_va_arg(list, BoardPassed<type_of_value>::type))

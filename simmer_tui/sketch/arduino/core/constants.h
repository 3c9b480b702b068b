// Names of levels, modes and numbers, as in Arduino's own core.
#pragma once

#define HIGH 0x1
#define LOW 0x0

#define INPUT 0x0
#define OUTPUT 0x1
#define INPUT_PULLUP 0x2
#if defined(SIMMER_ESP32)
#define INPUT_PULLDOWN 0x9
#endif

#define CHANGE 1
#define FALLING 2
#define RISING 3

#define DEC 10
#define HEX 16
#define OCT 8
#define BIN 2

#define LSBFIRST 0
#define MSBFIRST 1

#define DEFAULT 1
#define EXTERNAL 0
#if defined(SIMMER_MEGA)
#define INTERNAL1V1 2
#define INTERNAL2V56 3
#else
#define INTERNAL 3
#endif

#define SERIAL_8N1 0x06

#define PI 3.1415926535897932384626433832795
#define HALF_PI 1.5707963267948966192313216916398
#define TWO_PI 6.283185307179586476925286766559
#define DEG_TO_RAD 0.017453292519943295769236907684886
#define RAD_TO_DEG 57.295779513082320876798154814105
#define EULER 2.718281828459045235360287471352

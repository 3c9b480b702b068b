// Binary constants with one to eight digits: B0, B101, B00001111.
#pragma once

#define SIMMER_B1(digits, value) B##digits = value,
#define SIMMER_B2(digits, value) SIMMER_B1(digits##0, (value) * 2) SIMMER_B1(digits##1, (value) * 2 + 1)
#define SIMMER_B3(digits, value) SIMMER_B2(digits##0, (value) * 2) SIMMER_B2(digits##1, (value) * 2 + 1)
#define SIMMER_B4(digits, value) SIMMER_B3(digits##0, (value) * 2) SIMMER_B3(digits##1, (value) * 2 + 1)
#define SIMMER_B5(digits, value) SIMMER_B4(digits##0, (value) * 2) SIMMER_B4(digits##1, (value) * 2 + 1)
#define SIMMER_B6(digits, value) SIMMER_B5(digits##0, (value) * 2) SIMMER_B5(digits##1, (value) * 2 + 1)
#define SIMMER_B7(digits, value) SIMMER_B6(digits##0, (value) * 2) SIMMER_B6(digits##1, (value) * 2 + 1)
#define SIMMER_B8(digits, value) SIMMER_B7(digits##0, (value) * 2) SIMMER_B7(digits##1, (value) * 2 + 1)

enum : int {
  SIMMER_B1(0, 0) SIMMER_B1(1, 1) SIMMER_B2(0, 0) SIMMER_B2(1, 1) SIMMER_B3(0, 0) SIMMER_B3(1, 1)
  SIMMER_B4(0, 0) SIMMER_B4(1, 1) SIMMER_B5(0, 0) SIMMER_B5(1, 1) SIMMER_B6(0, 0) SIMMER_B6(1, 1)
  SIMMER_B7(0, 0) SIMMER_B7(1, 1) SIMMER_B8(0, 0) SIMMER_B8(1, 1)
};

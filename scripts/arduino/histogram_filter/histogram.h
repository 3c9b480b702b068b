// A histogram filter that fits into an Arduino Mega: a probability for every pose of atlas.h.
//
// A reading multiplies the probabilities, a movement shifts them. With cells of 6 in and 8 headings there are
// 1,024 poses of four bytes. atlas.h holds what the sensors read there, a byte each, in program memory.
#ifndef HISTOGRAM_H
#define HISTOGRAM_H

#include <string.h>

#include "atlas.h"

#define NO_ECHO 120.0f   // in, taken for a reading without an echo
#define OUTLIER 0.05f    // likelihood of a reading that nothing explains
#define FLOOR 1e-6f      // a probability of 0 would stay 0 whatever the readings say

float belief[ATLAS_HEADINGS][ATLAS_ROWS][ATLAS_COLUMNS];

// Makes the sum 1, and 0 of poses where the robot does not fit.
inline void normalise() {
  float sum = 0;
  for (uint16_t k = 0; k < ATLAS_HEADINGS; k++)
    for (uint16_t row = 0; row < ATLAS_ROWS; row++)
      for (uint16_t column = 0; column < ATLAS_COLUMNS; column++) {
        float *p = &belief[k][row][column];
        *p = atlas_free(row, column, k) ? *p + FLOOR : 0;
        sum += *p;
      }
  for (uint16_t pose = 0; pose < sizeof belief / sizeof(float); pose++) (&belief[0][0][0])[pose] /= sum;
}

// All poses alike.
inline void scatter() {
  for (uint16_t pose = 0; pose < sizeof belief / sizeof(float); pose++) (&belief[0][0][0])[pose] = 1;
  normalise();
}

// A reading of a sensor of atlas.h, in inches; INFINITY without an echo.
inline void update(uint8_t sensor, float reading) {
  for (uint16_t k = 0; k < ATLAS_HEADINGS; k++)
    for (uint16_t row = 0; row < ATLAS_ROWS; row++)
      for (uint16_t column = 0; column < ATLAS_COLUMNS; column++) {
        float expected = fminf(atlas_reading(row, column, k, sensor), NO_ECHO);
        // Half a cell and half a heading off, a sensor reads otherwise.
        float away = (fminf(reading, NO_ECHO) - expected) / (ATLAS_STEP / 2 + 0.1f * expected);
        belief[k][row][column] *= expf(-0.5f * away * away) + OUTLIER;
      }
  normalise();
}

// The robot has driven `ahead` inches and then turned by `turned` degrees, counter-clockwise. In place, but for
// one plane: there is no memory for a second belief.
inline void predict(float ahead, float turned) {
  float plane[ATLAS_ROWS][ATLAS_COLUMNS];
  for (uint16_t k = 0; k < ATLAS_HEADINGS; k++) {
    float angle = 6.2831853f * k / ATLAS_HEADINGS;
    float down = -ahead * sinf(angle) / ATLAS_STEP, right = ahead * cosf(angle) / ATLAS_STEP;
    int16_t rows = floorf(down), columns = floorf(right);
    float low = down - rows, far = right - columns;
    memcpy(plane, belief[k], sizeof plane);
    memset(belief[k], 0, sizeof plane);
    for (int16_t row = 0; row < ATLAS_ROWS; row++)
      for (int16_t column = 0; column < ATLAS_COLUMNS; column++)
        for (uint8_t corner = 0; corner < 4; corner++) {  // a place between four of the grid is shared by them
          int16_t to = row + rows + (corner & 1), at = column + columns + (corner >> 1);
          if (to < 0 || to >= ATLAS_ROWS || at < 0 || at >= ATLAS_COLUMNS) continue;
          float share = (corner & 1 ? low : 1 - low) * (corner >> 1 ? far : 1 - far);
          belief[k][to][at] += share * plane[row][column];
        }
  }
  float turns = turned * ATLAS_HEADINGS / 360.0f;
  int16_t whole = floorf(turns);
  float part = turns - whole;
  for (uint16_t row = 0; row < ATLAS_ROWS; row++)
    for (uint16_t column = 0; column < ATLAS_COLUMNS; column++) {
      float before[ATLAS_HEADINGS];
      for (uint16_t k = 0; k < ATLAS_HEADINGS; k++) before[k] = belief[k][row][column];
      for (int16_t k = 0; k < ATLAS_HEADINGS; k++) {
        int16_t from = (k - whole) % ATLAS_HEADINGS;
        if (from < 0) from += ATLAS_HEADINGS;
        float other = before[(from + ATLAS_HEADINGS - 1) % ATLAS_HEADINGS];
        belief[k][row][column] = (1 - part) * before[from] + part * other;
      }
    }
  normalise();
}

// The most probable pose; returns its probability.
inline float best(uint16_t &row, uint16_t &column, uint16_t &heading) {
  float most = -1;
  row = column = heading = 0;
  for (uint16_t k = 0; k < ATLAS_HEADINGS; k++)
    for (uint16_t r = 0; r < ATLAS_ROWS; r++)
      for (uint16_t c = 0; c < ATLAS_COLUMNS; c++)
        if (belief[k][r][c] > most) {
          most = belief[k][r][c];
          row = r, column = c, heading = k;
        }
  return most;
}

#endif

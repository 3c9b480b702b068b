// Sonars in an array of NewPing, one after the other, with a median; on a Mega.
#include <NewPing.h>
#define SONAR_NUM 3
#define MAX_DISTANCE 150
NewPing sonar[SONAR_NUM] = {
  NewPing(22, 23, MAX_DISTANCE),
  NewPing(24, 25, MAX_DISTANCE),
  NewPing(26, 27, MAX_DISTANCE),
};
unsigned int cm[SONAR_NUM];
uint8_t current = 0;
unsigned long nextPing = 0;

void setup() { Serial1.begin(9600); }

void loop() {
  if (millis() < nextPing) return;
  nextPing = millis() + 35;
  cm[current] = sonar[current].ping_cm();
  if (++current < SONAR_NUM) return;
  current = 0;
  for (uint8_t i = 0; i < SONAR_NUM; i++) {
    Serial1.print(cm[i]);
    Serial1.print(i + 1 < SONAR_NUM ? ',' : '\n');
  }
  if (cm[0] < 10) {
    Serial1.print("near ");
    Serial1.println(NewPing::convert_cm(sonar[0].ping_median(3)));
  }
}

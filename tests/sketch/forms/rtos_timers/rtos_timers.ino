// A one-shot timer stops the motors, another one counts on; bytes of the laptop start them.
#include <Arduino_FreeRTOS.h>
#include "timers.h"
#include "event_groups.h"

#define BIT_GO (1 << 0)
#define BIT_TURN (1 << 1)

int pwm[] = {5, 6};
int forwardPin[] = {7, 9};
int backwardPin[] = {8, 10};

TimerHandle_t stopTimer, beatTimer;
EventGroupHandle_t wishes;
int beats = 0;

void drive(int left, int right) {
  int speeds[2] = {left, right};
  for (int i = 0; i < 2; i++) {
    digitalWrite(forwardPin[i], speeds[i] > 0 ? HIGH : LOW);
    digitalWrite(backwardPin[i], speeds[i] < 0 ? HIGH : LOW);
    analogWrite(pwm[i], abs(speeds[i]));
  }
}

void stopNow(TimerHandle_t xTimer) {
  drive(0, 0);
  Serial.println("stop");
}

void beat(TimerHandle_t xTimer) {
  beats++;
  Serial.print("beat ");
  Serial.println(beats);
  if (beats == 3) xTimerChangePeriod(xTimer, 800 / portTICK_PERIOD_MS, 0);
}

void TaskMove(void *pvParameters) {
  for (;;) {
    EventBits_t bits = xEventGroupWaitBits(wishes, BIT_GO | BIT_TURN, pdTRUE, pdFALSE, portMAX_DELAY);
    if (bits & BIT_GO) drive(150, 150);
    else drive(130, -130);
    xTimerReset(stopTimer, 0);
  }
}

void TaskRead(void *pvParameters) {
  while (1) {
    while (Serial.available()) {
      char c = Serial.read();
      if (c == 'g') xEventGroupSetBits(wishes, BIT_GO);
      if (c == 't') xEventGroupSetBits(wishes, BIT_TURN);
      if (c == 'q') xTimerStop(beatTimer, 0);
    }
    vTaskDelay(1);
  }
}

void setup() {
  Serial.begin(9600);
  for (int i = 0; i < 2; i++) {
    pinMode(pwm[i], OUTPUT);
    pinMode(forwardPin[i], OUTPUT);
    pinMode(backwardPin[i], OUTPUT);
  }
  wishes = xEventGroupCreate();
  stopTimer = xTimerCreate("stop", pdMS_TO_TICKS(600), pdFALSE, 0, stopNow);
  beatTimer = xTimerCreate("beat", pdMS_TO_TICKS(500), pdTRUE, (void *)1, beat);
  xTaskCreate(TaskMove, "Move", 128, NULL, 2, NULL);
  xTaskCreate(TaskRead, "Read", 128, NULL, 1, NULL);
  if (xTimerStart(beatTimer, 0) != pdPASS) Serial.println("no timer");
}

void loop() {}

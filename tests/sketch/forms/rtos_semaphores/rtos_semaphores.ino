// A mutex guards Serial; an encoder's interrupt gives a semaphore to the task that counts.
#include <Arduino_FreeRTOS.h>
#include <semphr.h>

const uint8_t ENCODER = 2;
const uint8_t LEFT_PWM = 5, LEFT_A = 7, LEFT_B = 8;
const uint8_t RIGHT_PWM = 6, RIGHT_A = 9, RIGHT_B = 10;

SemaphoreHandle_t xSerialSemaphore = NULL;
SemaphoreHandle_t edgeSemaphore;
TaskHandle_t driveHandle;
volatile int ticks = 0;

void onEdge() {
  BaseType_t xHigherPriorityTaskWoken = pdFALSE;
  xSemaphoreGiveFromISR(edgeSemaphore, &xHigherPriorityTaskWoken);
  if (xHigherPriorityTaskWoken) vPortYield();
}

void say(const char *name, int value) {
  if (xSemaphoreTake(xSerialSemaphore, (TickType_t)10) == pdTRUE) {
    Serial.print(name);
    Serial.print(' ');
    Serial.println(value);
    xSemaphoreGive(xSerialSemaphore);
  }
}

void TaskCount(void *) {
  for (;;) {
    if (xSemaphoreTake(edgeSemaphore, portMAX_DELAY) != pdTRUE) continue;
    ticks++;
    if (ticks % 20 == 0) say("ticks", ticks);
    if (ticks == 60) xTaskNotifyGive(driveHandle);
  }
}

void TaskDrive(void *) {
  digitalWrite(LEFT_A, HIGH);
  digitalWrite(LEFT_B, LOW);
  digitalWrite(RIGHT_A, HIGH);
  digitalWrite(RIGHT_B, LOW);
  analogWrite(LEFT_PWM, 160);
  analogWrite(RIGHT_PWM, 160);
  say("go", 160);
  ulTaskNotifyTake(pdTRUE, portMAX_DELAY);
  analogWrite(LEFT_PWM, 0);
  analogWrite(RIGHT_PWM, 0);
  say("stopped", ticks);
  vTaskDelete(NULL);
}

void TaskAlive(void *) {
  TickType_t last = xTaskGetTickCount();
  for (int n = 1;; n++) {
    vTaskDelayUntil(&last, 1000 / portTICK_PERIOD_MS);
    say("alive", n);
  }
}

void setup() {
  Serial.begin(9600);
  while (!Serial) {
    ;
  }
  const uint8_t outputs[] = {LEFT_PWM, LEFT_A, LEFT_B, RIGHT_PWM, RIGHT_A, RIGHT_B};
  for (uint8_t i = 0; i < sizeof(outputs); i++) pinMode(outputs[i], OUTPUT);
  pinMode(ENCODER, INPUT_PULLUP);
  if (xSerialSemaphore == NULL) {
    xSerialSemaphore = xSemaphoreCreateMutex();
    if ((xSerialSemaphore) != NULL) xSemaphoreGive((xSerialSemaphore));
  }
  edgeSemaphore = xSemaphoreCreateBinary();
  xTaskCreate(TaskCount, "Count", 128, NULL, 3, NULL);
  xTaskCreate(TaskDrive, (const portCHAR *)"Drive", 128, NULL, 2, &driveHandle);
  xTaskCreate(TaskAlive, "Alive", 128, NULL, 1, NULL);
  attachInterrupt(digitalPinToInterrupt(ENCODER), onEdge, CHANGE);
  vTaskStartScheduler();
}

void loop() {}

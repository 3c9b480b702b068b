// A task measures, a task drives, and a queue is between them.
#include <Arduino_FreeRTOS.h>
#include <queue.h>

#define TRIG 11
#define ECHO 12
#define ENA 5
#define IN1 7
#define IN2 8
#define ENB 6
#define IN3 9
#define IN4 10

struct Measurement {
  unsigned long at;
  int distance;
};

QueueHandle_t measurements;

void TaskSonar(void *pvParameters);
void TaskDrive(void *pvParameters);

void setup() {
  Serial.begin(9600);
  pinMode(TRIG, OUTPUT);
  pinMode(ECHO, INPUT);
  for (int pin = ENA; pin <= IN4; pin++) pinMode(pin, OUTPUT);
  measurements = xQueueCreate(5, sizeof(struct Measurement));
  if (measurements != NULL) {
    xTaskCreate(TaskSonar, "Sonar", 128, NULL, 2, NULL);
    xTaskCreate(TaskDrive, "Drive", 192, NULL, 1, NULL);
  }
}

void loop() {}

void wheels(int left, int right) {
  digitalWrite(IN1, left >= 0);
  digitalWrite(IN2, left < 0);
  digitalWrite(IN3, right >= 0);
  digitalWrite(IN4, right < 0);
  analogWrite(ENA, abs(left));
  analogWrite(ENB, abs(right));
}

void TaskSonar(void *pvParameters __attribute__((unused))) {
  for (;;) {
    struct Measurement m;
    digitalWrite(TRIG, LOW);
    delayMicroseconds(2);
    digitalWrite(TRIG, HIGH);
    delayMicroseconds(10);
    digitalWrite(TRIG, LOW);
    long echo = pulseIn(ECHO, HIGH, 25000);
    m.at = millis();
    m.distance = echo / 58;
    xQueueSend(measurements, &m, portMAX_DELAY);
    vTaskDelay(60 / portTICK_PERIOD_MS);
  }
}

void TaskDrive(void *pvParameters __attribute__((unused))) {
  struct Measurement m;
  unsigned long count = 0;
  for (;;) {
    if (xQueueReceive(measurements, &m, pdMS_TO_TICKS(500)) == pdPASS) {
      if (m.distance > 0 && m.distance < 30) wheels(-140, 140);
      else wheels(150, 150);
      if (++count % 8 == 0) {
        Serial.print(m.at);
        Serial.print(": ");
        Serial.println(m.distance);
      }
    } else {
      wheels(0, 0);
    }
  }
}

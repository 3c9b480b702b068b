// A task on core 0 sums up the encoders' interrupts; loop() on core 1 drives a number of ticks.
const uint8_t LEFT_A = 34, LEFT_B = 35, RIGHT_A = 36, RIGHT_B = 39;
const uint8_t LEFT_PWM = 25, LEFT_DIR1 = 26, LEFT_DIR2 = 27;
const uint8_t RIGHT_PWM = 14, RIGHT_DIR1 = 12, RIGHT_DIR2 = 13;

portMUX_TYPE mux = portMUX_INITIALIZER_UNLOCKED;
volatile int leftEdges = 0, rightEdges = 0;
volatile long leftTotal = 0, rightTotal = 0;
TaskHandle_t encoderTask;
SemaphoreHandle_t reached;
const long GOAL = 400;

void IRAM_ATTR onLeft() {
  portENTER_CRITICAL_ISR(&mux);
  leftEdges += digitalRead(LEFT_A) == digitalRead(LEFT_B) ? -1 : 1;
  portEXIT_CRITICAL_ISR(&mux);
}

void IRAM_ATTR onRight() {
  portENTER_CRITICAL_ISR(&mux);
  rightEdges += digitalRead(RIGHT_A) == digitalRead(RIGHT_B) ? -1 : 1;
  portEXIT_CRITICAL_ISR(&mux);
}

void readEncoders(void *parameter) {
  Serial.print("encoders on core ");
  Serial.println(xPortGetCoreID());
  attachInterrupt(digitalPinToInterrupt(LEFT_A), onLeft, CHANGE);
  attachInterrupt(digitalPinToInterrupt(RIGHT_A), onRight, CHANGE);
  bool told = false;
  for (;;) {
    portENTER_CRITICAL(&mux);
    leftTotal += leftEdges;
    rightTotal += rightEdges;
    leftEdges = rightEdges = 0;
    portEXIT_CRITICAL(&mux);
    if (!told && leftTotal >= GOAL && rightTotal >= GOAL) {
      told = true;
      xSemaphoreGive(reached);
    }
    vTaskDelay(1 / portTICK_PERIOD_MS);
  }
}

void drive(int left, int right) {
  digitalWrite(LEFT_DIR1, left >= 0);
  digitalWrite(LEFT_DIR2, left < 0);
  digitalWrite(RIGHT_DIR1, right >= 0);
  digitalWrite(RIGHT_DIR2, right < 0);
  ledcWrite(LEFT_PWM, abs(left));
  ledcWrite(RIGHT_PWM, abs(right));
}

void setup() {
  Serial.begin(115200);
  for (int pin : {LEFT_DIR1, LEFT_DIR2, RIGHT_DIR1, RIGHT_DIR2}) pinMode(pin, OUTPUT);
  ledcAttach(LEFT_PWM, 20000, 8);
  ledcAttach(RIGHT_PWM, 20000, 8);
  reached = xSemaphoreCreateBinary();
  xTaskCreatePinnedToCore(readEncoders, "Encoders", 4096, NULL, 2, &encoderTask, 0);
  delay(100);
  Serial.printf("loop on core %d, %d-bit int\n", xPortGetCoreID(), 8 * sizeof(int));
  drive(160, 160);
  if (xSemaphoreTake(reached, pdMS_TO_TICKS(4000)) == pdTRUE) Serial.println("reached");
  drive(0, 0);
  delay(50);
  Serial.printf("%ld %ld\n", leftTotal, rightTotal);
}

void loop() {
  vTaskDelete(NULL);
}

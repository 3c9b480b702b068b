// Waits in an empty loop for a flag that only an interrupt sets: no call in the loop.
volatile bool slot = false;
volatile int count = 0;
const int EN = 5, A = 7, B = 8;

void passed() {
  count++;
  slot = true;
}

void setup() {
  Serial.begin(9600);
  pinMode(EN, OUTPUT);
  pinMode(A, OUTPUT);
  pinMode(B, OUTPUT);
  attachInterrupt(0, passed, FALLING);
  digitalWrite(A, HIGH);
  digitalWrite(B, LOW);
  analogWrite(EN, 130);
}

void loop() {
  slot = false;
  while (!slot) {
  }
  while (count % 5 != 0) {}
  Serial.println(count);
  if (count >= 40) {
    analogWrite(EN, 0);
    count = 1;
  }
}

// What numbers are on the wire: sizeof(int), a double of four bytes, an int that overflows.
int step = 30000;
double ratio = 1.0 / 3.0;
unsigned int counter = 65530;

union Packed {
  double value;
  byte bytes[sizeof(double)];
};

void setup() {
  Serial.begin(9600);
  Serial.println(sizeof(int));
  Serial.println(sizeof(double));
  Serial.println(sizeof(long));
  step = step + 10000;
  Serial.println(step);
  Serial.println(ratio, 6);
  Serial.println((long)step * 2);
  Packed p;
  p.value = ratio;
  Serial.write(p.bytes, sizeof(p.bytes));
  Serial.write((byte *)&step, sizeof(int));
}

void loop() {
  counter++;
  if (counter < 10) {
    Serial.println(counter);
    delay(50);
  }
}

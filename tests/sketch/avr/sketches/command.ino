// A pin by a letter, and lines by a word: as most teams' boards read commands.
const int LED = 8;
int count = 0;

void setup() {
  Serial.begin(9600);
  pinMode(LED, OUTPUT);
}

void loop() {
  if (Serial.available() == 0) return;
  char what = Serial.read();
  if (what == 'H') {
    digitalWrite(LED, HIGH);
    count++;
  } else if (what == 'L') {
    digitalWrite(LED, LOW);
    Serial.write('k');
  } else if (what == '?') {
    Serial.print("n=");
    Serial.println(count);
  } else if (what == 'w') {
    String word = Serial.readStringUntil('\n');
    word.trim();
    digitalWrite(LED, word == "on" ? HIGH : LOW);
    Serial.println(word);
  } else if (what == 'd') {
    delay(20);
    digitalWrite(LED, !digitalRead(LED));
    Serial.println(analogRead(A0) > 2000 ? 1 : 2);
  }
}

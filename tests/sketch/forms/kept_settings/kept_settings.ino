// Settings in EEPROM, texts in PROGMEM, characters by switch; a buzzer that nobody hears.
#include <EEPROM.h>
const char HELP[] PROGMEM = "g get, s set, t tone";
struct Settings { int gain; float offset; };
Settings settings;

void setup() {
  Serial.begin(9600);
  EEPROM.get(0, settings);
  if (settings.gain == -1) {
    settings.gain = 7;
    settings.offset = 0.25;
    EEPROM.put(0, settings);
  }
  for (unsigned int i = 0; i < strlen_P(HELP); i++) Serial.print((char)pgm_read_byte(HELP + i));
  Serial.println();
}

void loop() {
  if (!Serial.available()) return;
  switch (Serial.peek()) {
    case 'g':
      Serial.read();
      Serial.println(settings.gain * analogRead(A2) * settings.offset);
      break;
    case 's':
      Serial.read();
      settings.gain = Serial.parseInt();
      settings.offset = Serial.parseFloat();
      EEPROM.put(0, settings);
      Serial.println(F("saved"));
      break;
    case 't': tone(8, 440, 100); Serial.read(); break;
    default: Serial.read();
  }
}

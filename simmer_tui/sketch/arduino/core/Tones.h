// Tones of an ESP32's PWM: silent, as `tone` is. Another frequency changes no motor's speed either.
#pragma once

enum note_t { NOTE_C, NOTE_Cs, NOTE_D, NOTE_Eb, NOTE_E, NOTE_F, NOTE_Fs, NOTE_G, NOTE_Gs, NOTE_A, NOTE_Bb, NOTE_B, NOTE_MAX };
inline double ledcWriteTone(int, double frequency) { return frequency; }
inline double ledcWriteNote(int, note_t note, int octave) {
  constexpr double C0 = 16.35159783;  // Hz, in equal temperament with an A of 440 Hz
  return C0 * std::exp2(octave + note / 12.0);
}
inline double ledcChangeFrequency(int, unsigned int frequency, int) { return frequency; }

// As much of the Arduino API as the sketch needs, on a clock that only moves when something takes time.
#pragma once
#include <stdint.h>
#include <stdio.h>
#include <math.h>

constexpr int OUTPUT = 1, HIGH = 1, LOW = 0;
extern double clock_us;
inline uint32_t micros() { return uint32_t(uint64_t(clock_us)); }
inline void delayMicroseconds(unsigned us) { clock_us += us; }
inline void delay(unsigned ms) { clock_us += 1000.0 * ms; }
inline void pinMode(uint8_t, int) {}
void digitalWrite(uint8_t pin, int level);

struct HardwareSerial {
  void begin(uint32_t) {}
  void print(const char *text) { fputs(text, stdout); }
  void print(char one) { putchar(one); }
  void print(uint32_t number) { printf("%u", number); }
  void println(const char *text) { puts(text); }
  void println(uint32_t number) { printf("%u\n", number); }
  void println(int16_t number) { printf("%d\n", number); }
};
extern HardwareSerial Serial;

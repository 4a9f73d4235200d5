// Runs the sketch for five seconds beside a sensor whose oscillator is fast by some per cent, and holds it up once.
// Reading n counts n modulo 4096; stderr says when reading 0 was taken and how far apart they are [us].
#include <deque>
#include <stdlib.h>
#include "fifo_accelerometer.ino"

double clock_us = 4294967296.0 - 1.5e6;  // micros() wraps after 1.5 s
HardwareSerial Serial;
SPIClass SPI;

namespace {
const double BEGIN = clock_us;
double period_us = 1250, next_us = BEGIN + 100;
uint16_t made = 0;
bool measuring = false, over = false, selected = false;
uint8_t command = 0, at = 0;
std::deque<uint16_t> fifo;
uint16_t oldest = 0;

void catch_up() {
  for (; next_us <= clock_us; next_us += period_us) {
    if (!measuring) continue;
    if (fifo.size() == 33) {
      fifo.pop_front();
      over = true;
    }
    fifo.push_back(made++ & 0x0FFF);
  }
}

uint8_t answer() {
  switch (command & 0x3F) {
    case 0x00: return 0xE5;
    case 0x30: return over;
    case 0x39: return uint8_t(fifo.size());
  }
  uint8_t place = (command & 0x3F) - 0x32 + at;
  if (at == 0 && !fifo.empty()) {
    oldest = fifo.front();
    fifo.pop_front();
    over = false;
  }
  ++at;
  return place == 4 ? oldest & 0xFF : place == 5 ? oldest >> 8 : 0;
}
}  // namespace

void digitalWrite(uint8_t, int level) {
  selected = level == LOW;
  command = at = 0;
}

uint8_t SPIClass::transfer(uint8_t byte) {
  clock_us += 2;
  catch_up();
  if (!selected) return 0xFF;
  if (command == 0) {
    command = byte;
    return 0;
  }
  if (command & 0x80) return answer();
  if ((command & 0x3F) == 0x2D && byte == 0x08) {
    measuring = true;
    fprintf(stderr, "%.3f %.3f\n", next_us, period_us);
  }
  return 0;
}

int main(int, char **given) {
  period_us = atof(given[1]);
  double held_us = atof(given[2]);
  setup();
  while (clock_us < BEGIN + 5e6) {
    clock_us += 20;
    if (held_us > 0 && clock_us > BEGIN + 3e6) {
      clock_us += held_us;
      held_us = 0;
    }
    catch_up();
    loop();
  }
}

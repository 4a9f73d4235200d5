// An ADXL345 at the tip of the bar, as lines for lostmotion's driver csv_serial: "t_us,counts", and "#lost N".
// For ESP32 and RP2040 (Arduino cores of Espressif and Earle Philhower).  Wiring and configuration: docs/sensors.md.
#include "adxl345.h"
#include "stamped_fifo.h"

constexpr uint16_t RATE_HZ = 800;  // or 1600
constexpr uint8_t AXIS = 2;        // across the bar's thin side: 0 x, 1 y, 2 z
constexpr uint32_t BAUDRATE = 460800;
#if defined(ARDUINO_ARCH_RP2040)
constexpr uint8_t SELECT = 17;
#else
constexpr uint8_t SELECT = 5;
#endif

Adxl345 sensor(SPI, SELECT);
SampleClock stamps(1e6f / RATE_HZ);

void setup() {
  Serial.begin(BAUDRATE);
  SPI.begin();
  while (!sensor.begin(RATE_HZ)) {
    Serial.println("# no ADXL345 answers: check the wires and CS");
    delay(1000);
  }
}

void loop() {
  uint8_t count = sensor.waiting();
  if (count == 0) return;
  uint32_t now = micros();
  uint32_t lost = stamps.fetched(count, now, sensor.overrun());
  if (lost) {
    Serial.print("#lost ");
    Serial.println(lost);
  }
  for (; count; --count) {
    Serial.print(stamps.next());
    Serial.print(',');
    Serial.println(sensor.fetch(AXIS));
  }
}

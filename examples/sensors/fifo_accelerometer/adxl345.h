// The ADXL345 over SPI: 800 or 1600 readings a second into its FIFO of 32, +-16 g, 3.9 mg a count.
// Registers after the data sheet (Analog Devices, rev. G).
#pragma once
#include <Arduino.h>
#include <SPI.h>

class Adxl345 {
 public:
  using Bus = decltype(SPI);  // each core has a class of its own name

  Adxl345(Bus &spi, uint8_t select) : spi_(spi), select_(select) {}

  // Returns whether an ADXL345 answers; rate_hz: 800, 1600 or 3200.
  bool begin(uint16_t rate_hz) {
    pinMode(select_, OUTPUT);
    digitalWrite(select_, HIGH);
    if (read(0x00) != 0xE5) return false;               // DEVID
    write(0x2D, 0x00);                                  // POWER_CTL: standby while it is set up
    write(0x2C, rate_hz >= 3200 ? 0x0F : rate_hz >= 1600 ? 0x0E : 0x0D);  // BW_RATE
    write(0x31, 0x0B);                                  // DATA_FORMAT: full resolution, +-16 g
    write(0x38, 0x80 | 16);                             // FIFO_CTL: stream, the newest stay
    write(0x2D, 0x08);                                  // POWER_CTL: measure
    return true;
  }

  // Readings that wait in the FIFO and behind it, 0 to 33.
  uint8_t waiting() { return read(0x39) & 0x3F; }       // FIFO_STATUS

  // Whether readings were overwritten since the last one was fetched.
  bool overrun() { return read(0x30) & 0x01; }          // INT_SOURCE

  // Fetches the oldest; axis: 0 x, 1 y, 2 z.  All six bytes go at once, or the FIFO would move on in between.
  int16_t fetch(uint8_t axis) {
    uint8_t data[6];
    begin_transfer(0x32 | 0x80 | 0x40);                 // DATAX0, read, several
    for (uint8_t &one : data) one = spi_.transfer(0);
    end_transfer();
    delayMicroseconds(5);                               // the FIFO's time to move up
    return int16_t(data[2 * axis] | data[2 * axis + 1] << 8);
  }

 private:
  void begin_transfer(uint8_t command) {
    spi_.beginTransaction(SPISettings(5000000, MSBFIRST, SPI_MODE3));
    digitalWrite(select_, LOW);
    spi_.transfer(command);
  }

  void end_transfer() {
    digitalWrite(select_, HIGH);
    spi_.endTransaction();
  }

  uint8_t read(uint8_t reg) {
    begin_transfer(reg | 0x80);
    uint8_t value = spi_.transfer(0);
    end_transfer();
    return value;
  }

  void write(uint8_t reg, uint8_t value) {
    begin_transfer(reg);
    spi_.transfer(value);
    end_transfer();
  }

  Bus &spi_;
  uint8_t select_;
};

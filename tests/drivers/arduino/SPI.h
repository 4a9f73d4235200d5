// An SPI bus with an ADXL345 on it: its registers, its FIFO of 32 and one, and what overwrites it.
#pragma once
#include "Arduino.h"

constexpr int MSBFIRST = 1, SPI_MODE3 = 3;
struct SPISettings {
  SPISettings(uint32_t, int, int) {}
};
struct SPIClass {
  void begin() {}
  void beginTransaction(SPISettings) {}
  void endTransaction() {}
  uint8_t transfer(uint8_t byte);
};
extern SPIClass SPI;

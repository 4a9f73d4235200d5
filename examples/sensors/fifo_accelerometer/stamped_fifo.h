// Readings out of a sensor's FIFO as lines "t_us,counts" with evenly spaced times, and "#lost N" where the FIFO ran over.
// No Arduino in here: tests/examples/test_sensor_sketch.py compiles it on the host.
#pragma once
#include <stdint.h>

// Gives readings their times.  The sensor's own oscillator paces them (some per cent off its nominal rate), micros() of
// the moment when they were fetched is late by up to the time between two looks.  A phase-locked loop follows the mean.
class SampleClock {
 public:
  explicit SampleClock(float nominal_us) : period_us_(nominal_us), nominal_us_(nominal_us) {}

  // Told how many readings were fetched at micros() = now, and whether the FIFO has run over since the last time.
  // Returns how many are lost before them.
  uint32_t fetched(uint32_t count, uint32_t now, bool overrun) {
    if (!started_) {
      started_ = true;
      first(now, count);
      return 0;
    }
    float late = float(int32_t(now - last_us_)) - part_us_ - count * period_us_;
    uint32_t lost = 0;
    if (overrun && late > 0) lost = uint32_t(late / period_us_ + 0.05f);  // the newest is up to a period old: round down
    if (overrun && lost == 0) lost = 1;  // the sensor says so
    advance(lost * period_us_);
    late -= lost * period_us_;
    follow(late, count, lost > 0);
    return lost;
  }

  // The time of the next reading [us]; wraps after 71 minutes, as micros() does.
  uint32_t next() {
    advance(period_us_ + pull_us_);
    return last_us_;
  }

  float period_us() const { return period_us_; }

 private:
  void first(uint32_t now, uint32_t count) {
    last_us_ = now - uint32_t(count * period_us_);
    part_us_ = pull_us_ = 0;
  }

  // Takes up a part of the lateness at once and a smaller one in the period, which stays within 10 % of its nominal.
  void follow(float late, uint32_t count, bool jumped) {
    pull_us_ = count ? late / (32 * count) : 0;
    if (!jumped) period_us_ += late / 4096;
    if (period_us_ > 1.1f * nominal_us_) period_us_ = 1.1f * nominal_us_;
    if (period_us_ < 0.9f * nominal_us_) period_us_ = 0.9f * nominal_us_;
  }

  void advance(float us) {
    part_us_ += us;
    int32_t whole = int32_t(part_us_);
    last_us_ += whole;
    part_us_ -= whole;
  }

  float period_us_, nominal_us_;
  uint32_t last_us_ = 0;
  float part_us_ = 0, pull_us_ = 0;
  bool started_ = false;
};

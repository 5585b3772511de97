// Prints an MPU-6050 at 200 Hz for arduino-mpu6050.toml. Registers: InvenSense RM-MPU-6000A-00 rev. 4.2.
#include <Wire.h>

const uint8_t DEVICE = 0x68;
uint16_t counter = 0;
uint32_t next_us = 0;

void set(uint8_t place, uint8_t value) {
  Wire.beginTransmission(DEVICE);
  Wire.write(place);
  Wire.write(value);
  Wire.endTransmission();
}

void setup() {
  Serial.begin(115200);
  Wire.begin();
  Wire.setClock(400000);
  set(0x6B, 1);      // awake, clock of the gyroscope
  set(0x1A, 3);      // low-pass of 44 Hz
  set(0x19, 4);      // 1000 Hz / (1 + 4)
  set(0x1B, 1 << 3); // 500 deg/s
  set(0x1C, 1 << 3); // 4 g
  next_us = micros();
}

void loop() {
  if ((int32_t)(micros() - next_us) < 0) return;
  next_us += 5000;
  const uint32_t now_us = micros();
  Wire.beginTransmission(DEVICE);
  Wire.write(0x3B);
  Wire.endTransmission(false);
  if (Wire.requestFrom(DEVICE, (uint8_t)14) != 14) { counter++; return; } // a gap, and known
  int16_t raw[7];
  for (int16_t &number : raw) {
    const uint8_t high = Wire.read();
    number = (int16_t)(high << 8 | Wire.read());
  }
  char temperature[12];
  dtostrf(raw[3] / 340.0 + 36.53, 1, 3, temperature);
  char line[96];
  snprintf(line, sizeof line, "$IMU,%u,%lu,%d,%d,%d,%s,%d,%d,%d", counter++, (unsigned long)now_us,
           raw[0], raw[1], raw[2], temperature, raw[4], raw[5], raw[6]);
  uint8_t sum = 0;
  for (const char *at = line + 1; *at; at++) sum ^= *at;
  char end[6];
  snprintf(end, sizeof end, "*%02X", sum);
  Serial.print(line);
  Serial.println(end);
}

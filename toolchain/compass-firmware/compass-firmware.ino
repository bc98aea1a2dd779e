// The compass: a Devantech CMPS11 on the I2C bus of an Arduino Uno, ten times a second as NMEA 0183 at 9600 baud.
//
//     $HCHDM,123.4,M*2D                        heading, as the instrument reads, degrees
//     $HCXDR,A,-3,D,PITCH,A,12,D,ROLL*03       pitch (bow up positive) and roll (starboard down positive), degrees
//
// A reading that fails is never replaced by the one before: the heading field stays empty ($HCHDM,,M*07), which says
// that the Arduino lives and its compass does not, and XDR stays away. HDM comes first, so that the heading is not
// late by the length of the other sentence.
//
// Wiring: SDA to A4, SCL to A5, 5 V, ground; the CMPS11's mode pin stays unconnected (I2C).

#include <Wire.h>
#include <avr/wdt.h>

namespace {

constexpr uint8_t CMPS11_ADDRESS = 0x60;    // 0xC0 in Devantech's eight-bit notation
constexpr uint8_t BEARING_REGISTER = 2;     // then: bearing high, bearing low, pitch, roll
constexpr uint8_t READING_SIZE = 4;         // bytes
constexpr uint16_t FULL_CIRCLE = 3600;      // tenths of a degree
constexpr uint32_t BAUD = 9600;             // sensors.compass.baud
constexpr uint32_t PERIOD_MS = 100;         // 10 Hz
constexpr uint32_t I2C_TIMEOUT_US = 10000;  // a reading takes 0.7 ms at 100 kHz
constexpr uint8_t TEXT_SIZE = 48;           // bytes; the longest sentence has 38

// Devantech's page says "angle from the horizontal plane" and no sign. Turn the board until PITCH is positive with the
// bow up and ROLL with the starboard side down, or change the sign here.
constexpr int8_t PITCH_SIGN = 1;
constexpr int8_t ROLL_SIGN = 1;

struct Reading {
    uint16_t bearing_tenths;  // [0, 3600)
    int8_t pitch_deg;
    int8_t roll_deg;
};

uint32_t due_ms;  // when the next reading is due

void start_bus() {
    Wire.begin();
    Wire.setWireTimeout(I2C_TIMEOUT_US, true);
}

// A compass that lost count in the middle of a byte holds SDA low and the bus with it. Nine clocks let it finish, a
// STOP ends the transfer. Lines are only pulled low or let go, as on any I2C bus.
void recover_bus() {
    constexpr uint8_t HALF_CLOCK_US = 5;  // 100 kHz
    Wire.end();
    pinMode(SDA, INPUT_PULLUP);
    for (uint8_t clock = 0; clock < 9; clock++) {
        digitalWrite(SCL, LOW);
        pinMode(SCL, OUTPUT);
        delayMicroseconds(HALF_CLOCK_US);
        pinMode(SCL, INPUT_PULLUP);
        delayMicroseconds(HALF_CLOCK_US);
    }
    digitalWrite(SDA, LOW);
    pinMode(SDA, OUTPUT);
    delayMicroseconds(HALF_CLOCK_US);
    pinMode(SDA, INPUT_PULLUP);  // rises while SCL is high: STOP
    delayMicroseconds(HALF_CLOCK_US);
    start_bus();
}

// Reads bearing, pitch and roll in one transfer; false where any part of it failed or cannot be true.
bool read_compass(Reading *reading) {
    Wire.clearWireTimeoutFlag();
    Wire.beginTransmission(CMPS11_ADDRESS);
    Wire.write(BEARING_REGISTER);
    const bool addressed = Wire.endTransmission(false) == 0;
    const uint8_t received = addressed ? Wire.requestFrom(CMPS11_ADDRESS, READING_SIZE) : 0;
    if (received != READING_SIZE) {
        recover_bus();
        return false;
    }
    const uint8_t high = Wire.read();
    const uint8_t low = Wire.read();
    reading->bearing_tenths = static_cast<uint16_t>(high << 8 | low);
    reading->pitch_deg = static_cast<int8_t>(Wire.read());
    reading->roll_deg = static_cast<int8_t>(Wire.read());
    return reading->bearing_tenths < FULL_CIRCLE;  // a floating bus reads as 65,535
}

// Prints $BODY*hh with its checksum.
void print_sentence(const char *body) {
    uint8_t checksum = 0;
    for (const char *c = body; *c != '\0'; c++) {
        checksum ^= static_cast<uint8_t>(*c);
    }
    char tail[8];
    snprintf_P(tail, sizeof tail, PSTR("*%02X\r\n"), checksum);
    Serial.write('$');
    Serial.print(body);
    Serial.print(tail);
}

void print_heading(uint16_t bearing_tenths) {
    char body[TEXT_SIZE];
    snprintf_P(body, sizeof body, PSTR("HCHDM,%u.%u,M"), bearing_tenths / 10, bearing_tenths % 10);
    print_sentence(body);
}

void print_attitude(int pitch_deg, int roll_deg) {
    char body[TEXT_SIZE];
    snprintf_P(body, sizeof body, PSTR("HCXDR,A,%d,D,PITCH,A,%d,D,ROLL"), pitch_deg, roll_deg);
    print_sentence(body);
}

}  // namespace

// After a reset by the watchdog it is still running, at its shortest period: stopped before anything else happens.
void stop_watchdog() __attribute__((naked, used, section(".init3")));
void stop_watchdog() {
    MCUSR = 0;
    wdt_disable();
}

void setup() {
    Serial.begin(BAUD);
    start_bus();
    wdt_enable(WDTO_1S);
    due_ms = millis();
}

void loop() {
    wdt_reset();
    const uint32_t late_ms = millis() - due_ms;
    if (late_ms >= UINT32_MAX / 2) {  // not yet due
        return;
    }
    due_ms += PERIOD_MS * (1 + late_ms / PERIOD_MS);  // readings that were missed are not made up for
    Reading reading;
    if (read_compass(&reading)) {
        print_heading(reading.bearing_tenths);
        print_attitude(PITCH_SIGN * reading.pitch_deg, ROLL_SIGN * reading.roll_deg);
    } else {
        print_sentence("HCHDM,,M");
    }
}

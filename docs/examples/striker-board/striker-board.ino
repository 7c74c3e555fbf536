// Reference striker board for Percuss, protocol 1 (docs/reference/striker-protocol.md). For Arduino Uno, Nano
// and Mega (16 MHz AVR). Adjust the numbers in capitals to your striker; measure the pulses before you trust them.
#include <Arduino.h>
const uint8_t DRIVE = 9;        // to the gate of the drive's MOSFET, with 10 kOhm to ground: off while in reset
const uint8_t CONTACT = 2;      // contact sensor, which pulls to ground; INT0
const uint8_t DRAWN_BACK = 4;   // switch to ground, closed while drawn back; without one wire it to ground
const char ABOUT[] = "reference 100 600 contact";          // name, speeds [mm/s], none|contact|speed
const long SLOWEST = 100, FASTEST = 600;                   // the same speeds [mm/s]
const long PULSE_SLOWEST = 8, PULSE_FASTEST = 40;          // drive's pulse at these speeds [ms], at most 250
const unsigned long SILENCE = 400, LONGEST_ARMING = 60000, BOUNCE = 10000;   // [ms], [ms], [us]

enum State : uint8_t { SAFE, ARMED, FIRED };
volatile State state = SAFE;
volatile unsigned long fired, contact, touched;            // [us]
volatile unsigned int contacts;
unsigned long heard, armed, arming;                        // [ms]
char line[64], reply[64];
uint8_t length;

ISR(TIMER1_COMPA_vect) { digitalWrite(DRIVE, LOW); TIMSK1 = 0; }   // ends the pulse whatever the loop does

void felt() {
  unsigned long now = micros();
  if (state == FIRED && (!contacts || now - touched > BOUNCE)) {
    if (!contacts) contact = now;
    contacts++;
  }
  touched = now;
}

void drive(long ms) {
  noInterrupts();
  TCCR1A = 0; TCCR1B = _BV(CS12) | _BV(CS10); TCNT1 = 0;   // 15.625 ticks a millisecond
  OCR1A = ms * 125 / 8; TIFR1 = _BV(OCF1A); TIMSK1 = _BV(OCIE1A);
  contacts = 0; state = FIRED; fired = micros(); digitalWrite(DRIVE, HIGH);
  interrupts();
}

const char *obey(const char *verb, long value) {           // refusal, or 0
  if (!strcmp(verb, "state")) return 0;
  if (!strcmp(verb, "fire")) {
    if (state != ARMED || digitalRead(DRAWN_BACK)) return "not-armed";
    if (value < SLOWEST || value > FASTEST) return "speed";
    drive(constrain(map(value, SLOWEST, FASTEST, PULSE_SLOWEST, PULSE_FASTEST), 0, 250));
    return 0;
  }
  if (strcmp(verb, "stop") && strcmp(verb, "arm")) return "verb";
  digitalWrite(DRIVE, LOW); contacts = 0; state = SAFE;
  if (!strcmp(verb, "stop")) return 0;
  if (value <= 0) return "argument";
  armed = millis(); arming = min((unsigned long)value, LONGEST_ARMING); state = ARMED;
  return 0;
}

uint8_t check(const char *text) { uint8_t sum = 0; while (*text && *text != '*') sum ^= *text++; return sum; }

void answer() {
  char verb[8] = ""; unsigned int number = 0; long value = 0;
  char *star = strchr(line, '*');
  if (!star || strtol(star + 1, 0, 16) != check(line)) return;   // a damaged line gets no reply
  *star = 0;
  if (sscanf(line, "%u %7s %ld", &number, verb, &value) < 2) return;
  heard = millis();
  if (!strcmp(verb, "hello")) snprintf(reply, 60, "%u hello percuss-striker 1 %s", number, ABOUT);
  else if (!strcmp(verb, "time")) snprintf(reply, 60, "%u time %lu", number, micros());
  else if (const char *why = obey(verb, value)) snprintf(reply, 60, "%u refused %s", number, why);
  else {
    noInterrupts(); unsigned long f = fired, c = contact; unsigned int n = contacts; interrupts();
    const char *name = digitalRead(DRAWN_BACK) ? "loading" : "armed";
    if (state != ARMED) name = state == SAFE ? "safe" : "fired";
    snprintf(reply, 60, "%u %s %lu %u %lu 0 0", number, name, f, n, c);
  }
  uint8_t sum = check(reply);
  Serial.print(reply); Serial.print('*');
  if (sum < 16) Serial.print('0');
  Serial.print(sum, HEX); Serial.print('\n');
}

void setup() {
  digitalWrite(DRIVE, LOW); pinMode(DRIVE, OUTPUT);
  pinMode(CONTACT, INPUT_PULLUP); pinMode(DRAWN_BACK, INPUT_PULLUP);
  attachInterrupt(digitalPinToInterrupt(CONTACT), felt, FALLING);
  Serial.begin(1000000);                                   // exact on a 16 MHz AVR, unlike 115200
}

void loop() {
  if (state == ARMED && (millis() - heard > SILENCE || millis() - armed > arming)) state = SAFE;
  while (Serial.available()) {
    char c = Serial.read();
    if (c != '\n') { if (length < 63) line[length] = c; length = min(length + 1, 64); continue; }
    if (length < 64) { line[length] = 0; answer(); }
    length = 0;
  }
}

/*
 * Nuvoton NUC980 real-time clock
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 *
 * The time is QEMU's (-rtc), shifted by what the guest sets. A battery keeps
 * all but the interrupts over a reset (guess). Without one (battery=off) it
 * is not active until it is given INIT's key.
 */

#include "qemu/osdep.h"
#include "hw/irq.h"
#include "hw/misc/nuc980_unimp.h"
#include "hw/qdev-properties.h"
#include "hw/registerfields.h"
#include "hw/rtc/nuc980_rtc.h"
#include "migration/vmstate.h"
#include "qemu/bcd.h"
#include "qemu/cutils.h"
#include "sysemu/rtc.h"
#include "sysemu/sysemu.h"
#include "trace.h"

REG32(RTC_INIT, 0x00)
    FIELD(RTC_INIT, ACTIVE, 0, 1)
REG32(RTC_RWEN, 0x04)
    FIELD(RTC_RWEN, RWENF, 16, 1)
REG32(RTC_FREQADJ, 0x08)
REG32(RTC_TIME, 0x0c)               /* BCD: hours, minutes, seconds */
REG32(RTC_CAL, 0x10)                /* BCD: year, month, day */
REG32(RTC_TIMEFMT, 0x14)
    FIELD(RTC_TIMEFMT, H24, 0, 1)
REG32(RTC_WEEKDAY, 0x18)            /* 0: Sunday */
REG32(RTC_TALM, 0x1c)
REG32(RTC_CALM, 0x20)
    FIELD(RTC_CALM, DATE, 0, 24)
    FIELD(RTC_CALM, WEEKDAY, 24, 3)
    FIELD(RTC_CALM, ANYDAY, 31, 1)  /* the weekday does not count */
REG32(RTC_LEAPYEAR, 0x24)
REG32(RTC_INTEN, 0x28)
REG32(RTC_INTSTS, 0x2c)             /* write 1 to clear */
    FIELD(RTC_INTSTS, ALM, 0, 1)    /* INTEN has the same bits */
    FIELD(RTC_INTSTS, TICK, 1, 1)
    FIELD(RTC_INTSTS, BUSY, 31, 1)  /* the last write has not arrived */
REG32(RTC_TICK, 0x30)               /* every 1/2^n second */
REG32(RTC_PWRCTL, 0x34)
    FIELD(RTC_PWRCTL, ALARM_EN, 3, 1)
REG32(RTC_SPR0, 0x40)
REG32(RTC_SPR15, 0x7c)

#define INIT_KEY        0xa5eb1357
#define RWEN_KEY        0xa965
#define X32K_HZ         32768
#define RWEN_CLOCKS     1024
#define WRITE_CLOCKS    2           /* guess */
#define TICK_MASK       7
#define HALF_DAY        12
#define PM              20          /* added to the hours of a 12-hour clock */

#define INT_BITS        (R_RTC_INTSTS_ALM_MASK | R_RTC_INTSTS_TICK_MASK)

#define CENTURY_BEGIN 946684800LL               /* 2000-01-01 */
#define CENTURY_SECONDS (36525LL * 24 * 3600)

static int64_t rtc_in_clocks(int clocks)
{
    return qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) +
           muldiv64(clocks, NANOSECONDS_PER_SECOND, X32K_HZ);
}

static bool rtc_is_open(NUC980RTCState *s)
{
    return qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) < s->open_until_ns;
}

static bool rtc_is_busy(NUC980RTCState *s)
{
    return qemu_clock_get_ns(QEMU_CLOCK_VIRTUAL) < s->busy_until_ns;
}

static uint32_t rtc_pack(int high, int middle, int low)
{
    return to_bcd(high) << 16 | to_bcd(middle) << 8 | to_bcd(low);
}

/* 12-hour clock: 12 AM, 1 AM .. 11 AM, 12 PM (32), 1 PM (21) .. 11 PM (31) */
static int rtc_pack_hour(NUC980RTCState *s, int hour)
{
    if (FIELD_EX32(s->timefmt, RTC_TIMEFMT, H24)) {
        return hour;
    }
    return (hour % HALF_DAY ?: HALF_DAY) + (hour < HALF_DAY ? 0 : PM);
}

static int rtc_unpack_hour(NUC980RTCState *s, int hour)
{
    if (FIELD_EX32(s->timefmt, RTC_TIMEFMT, H24)) {
        return hour;
    }
    return hour > PM ? (hour - PM) % HALF_DAY + HALF_DAY : hour % HALF_DAY;
}

static bool is_bcd(uint32_t value)
{
    for (; value; value >>= 4) {
        if ((value & 0xf) > 9) {
            return false;
        }
    }
    return true;
}

static bool rtc_unpack_time(NUC980RTCState *s, uint32_t value, struct tm *tm)
{
    tm->tm_hour = rtc_unpack_hour(s, from_bcd(extract32(value, 16, 8)));
    tm->tm_min = from_bcd(extract32(value, 8, 8));
    tm->tm_sec = from_bcd(extract32(value, 0, 8));
    return is_bcd(value) && tm->tm_hour < 24 && tm->tm_min < 60 &&
           tm->tm_sec < 60;
}

static bool rtc_unpack_date(uint32_t value, struct tm *tm)
{
    tm->tm_year = from_bcd(extract32(value, 16, 8)) + 100;
    tm->tm_mon = from_bcd(extract32(value, 8, 8)) - 1;
    tm->tm_mday = from_bcd(extract32(value, 0, 8));
    return is_bcd(value) && tm->tm_mon >= 0 && tm->tm_mon < 12 &&
           tm->tm_mday >= 1 && tm->tm_mday <= 31;
}

/*
 * The chip counts 2000 to 2099, all with a leap day each four years, and
 * begins anew. QEMU's own offset is an int: two centuries' ends are further
 * from each other than that.
 */
static void rtc_now(NUC980RTCState *s, struct tm *tm)
{
    int64_t since;
    time_t now;

    qemu_get_timedate(tm, 0);
    since = (mktimegm(tm) + s->offset - CENTURY_BEGIN) % CENTURY_SECONDS;
    now = CENTURY_BEGIN + (since < 0 ? since + CENTURY_SECONDS : since);
    gmtime_r(&now, tm);
}

static int rtc_weekday(NUC980RTCState *s, const struct tm *tm)
{
    return (tm->tm_wday + s->weekday_offset) % 7;
}

static int64_t rtc_tick(NUC980RTCState *s)
{
    return qemu_clock_get_ns(rtc_clock) /
           (NANOSECONDS_PER_SECOND >> s->tick_period);
}

/* When rtc_clock shows the alarm's time; its seconds begin with the RTC's */
static int64_t rtc_find_alarm(NUC980RTCState *s)
{
    int64_t second = qemu_clock_get_ns(rtc_clock) / NANOSECONDS_PER_SECOND;
    struct tm now, alarm = { };
    int64_t left;

    rtc_now(s, &now);
    if (!FIELD_EX32(s->pwrctl, RTC_PWRCTL, ALARM_EN) ||
        !rtc_unpack_time(s, s->talm, &alarm) ||
        !rtc_unpack_date(FIELD_EX32(s->calm, RTC_CALM, DATE), &alarm)) {
        return INT64_MAX;
    }
    left = mktimegm(&alarm) - mktimegm(&now);
    if (!FIELD_EX32(s->calm, RTC_CALM, ANYDAY)) {
        int64_t today = mktimegm(&now) / (24 * 3600);
        int64_t days = mktimegm(&alarm) / (24 * 3600) - today;

        if ((rtc_weekday(s, &now) + days) % 7 !=
            FIELD_EX32(s->calm, RTC_CALM, WEEKDAY)) {
            return INT64_MAX;
        }
    }
    return left > 0 ? (second + left) * NANOSECONDS_PER_SECOND : INT64_MAX;
}

/* Brings INTSTS up to now. */
static void rtc_sync(NUC980RTCState *s)
{
    int64_t tick = rtc_tick(s);

    if (tick != s->tick) {
        s->tick = tick;
        s->intsts |= R_RTC_INTSTS_TICK_MASK;
    }
    if (qemu_clock_get_ns(rtc_clock) >= s->alarm_ns) {
        trace_nuc980_rtc_alarm();
        s->alarm_ns = INT64_MAX;
        s->intsts |= R_RTC_INTSTS_ALM_MASK;
    }
}

/* Ticks that nobody would notice need no timer: rtc_sync() finds them. */
static void rtc_update(NUC980RTCState *s)
{
    int64_t next = s->alarm_ns;

    qemu_set_irq(s->irq, (s->inten & s->intsts) != 0);
    if (s->inten & ~s->intsts & R_RTC_INTSTS_TICK_MASK) {
        next = MIN(next, (s->tick + 1) *
                         (NANOSECONDS_PER_SECOND >> s->tick_period));
    }
    if (next == INT64_MAX) {
        timer_del(s->timer);
    } else {
        timer_mod(s->timer, next);
    }
}

static void rtc_expired(void *opaque)
{
    NUC980RTCState *s = opaque;

    rtc_sync(s);
    rtc_update(s);
}

static bool rtc_is_leap_year(const struct tm *tm)
{
    return tm->tm_year % 4 == 0;    /* 2000 to 2099 */
}

static uint64_t rtc_read(void *opaque, hwaddr addr, unsigned size)
{
    NUC980RTCState *s = opaque;
    struct tm tm;

    rtc_sync(s);
    rtc_now(s, &tm);
    switch (addr) {
    case A_RTC_INIT:
        return s->battery || s->active ? R_RTC_INIT_ACTIVE_MASK : 0;
    case A_RTC_RWEN:
        return rtc_is_open(s) ? R_RTC_RWEN_RWENF_MASK : 0;
    case A_RTC_FREQADJ:
        return s->freqadj;
    case A_RTC_TIME:
        return rtc_pack(rtc_pack_hour(s, tm.tm_hour), tm.tm_min, tm.tm_sec);
    case A_RTC_CAL:
        return rtc_pack(tm.tm_year % 100, tm.tm_mon + 1, tm.tm_mday);
    case A_RTC_TIMEFMT:
        return s->timefmt;
    case A_RTC_WEEKDAY:
        return rtc_weekday(s, &tm);
    case A_RTC_TALM:
        return s->talm;
    case A_RTC_CALM:
        return s->calm;
    case A_RTC_LEAPYEAR:
        return rtc_is_leap_year(&tm);
    case A_RTC_INTEN:
        return s->inten;
    case A_RTC_INTSTS:
        return FIELD_DP32(s->intsts, RTC_INTSTS, BUSY, rtc_is_busy(s));
    case A_RTC_TICK:
        return s->tick_period;
    case A_RTC_PWRCTL:
        return s->pwrctl;
    case A_RTC_SPR0 ... A_RTC_SPR15:
        return s->spare[(addr - A_RTC_SPR0) / 4];
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_RTC, addr);
        return 0;
    }
}

static void rtc_set(NUC980RTCState *s, struct tm *tm, bool valid)
{
    struct tm now;
    int weekday;

    if (!valid) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: no such time or date\n",
                      TYPE_NUC980_RTC);
        return;
    }
    rtc_now(s, &now);
    weekday = rtc_weekday(s, &now);
    s->offset += mktimegm(tm) - mktimegm(&now);
    rtc_now(s, &now);
    s->weekday_offset = (weekday - now.tm_wday + 7) % 7;
    trace_nuc980_rtc_set(s->offset);
}

static void rtc_write_time(NUC980RTCState *s, uint32_t value)
{
    struct tm tm;

    rtc_now(s, &tm);
    rtc_set(s, &tm, rtc_unpack_time(s, value, &tm));
}

static void rtc_write_date(NUC980RTCState *s, uint32_t value)
{
    struct tm tm;

    rtc_now(s, &tm);
    rtc_set(s, &tm, rtc_unpack_date(value, &tm));
}

static void rtc_write_weekday(NUC980RTCState *s, uint32_t value)
{
    struct tm tm;

    rtc_now(s, &tm);
    s->weekday_offset = (value % 7 - tm.tm_wday + 7) % 7;
}

static void rtc_write_rwen(NUC980RTCState *s, uint32_t value)
{
    s->open_until_ns = value == RWEN_KEY ? rtc_in_clocks(RWEN_CLOCKS) : 0;
}

/*
 * The registers that the vendor's Linux driver and BSP open by RWEN before
 * they write. TIMEFMT, INTEN and INTSTS Linux writes without.
 */
static bool rtc_is_protected(hwaddr addr)
{
    switch (addr) {
    case A_RTC_INIT ... A_RTC_RWEN:
    case A_RTC_TIMEFMT:
    case A_RTC_INTEN ... A_RTC_INTSTS:
        return false;
    default:
        return true;
    }
}

/* A register's bits with no effect here */
static void rtc_log_bits(NUC980RTCState *s, hwaddr addr, uint32_t bits)
{
    if (bits) {
        nuc980_unimp_once(s->seen, TYPE_NUC980_RTC, addr);
    }
}

static void rtc_write_register(NUC980RTCState *s, hwaddr addr, uint32_t value)
{
    switch (addr) {
    case A_RTC_INIT:
        s->active |= value == INIT_KEY;
        if (value != INIT_KEY) {
            qemu_log_mask(LOG_GUEST_ERROR, "%s: not the key of INIT\n",
                          TYPE_NUC980_RTC);
        }
        break;
    case A_RTC_RWEN:
        rtc_write_rwen(s, value);
        break;
    case A_RTC_FREQADJ:             /* the time needs no correction here */
        s->freqadj = value;
        rtc_log_bits(s, addr, value);
        break;
    case A_RTC_TIME:
        rtc_write_time(s, value);
        break;
    case A_RTC_CAL:
        rtc_write_date(s, value);
        break;
    case A_RTC_TIMEFMT:
        s->timefmt = value & R_RTC_TIMEFMT_H24_MASK;
        break;
    case A_RTC_WEEKDAY:
        rtc_write_weekday(s, value);
        break;
    case A_RTC_TALM:
        s->talm = value;
        rtc_log_bits(s, addr, value & 0xff000000);
        break;
    case A_RTC_CALM:
        s->calm = value;
        rtc_log_bits(s, addr, value & 0x78000000);
        break;
    case A_RTC_INTEN:
        s->inten = value;
        rtc_log_bits(s, addr, value & ~INT_BITS);
        break;
    case A_RTC_INTSTS:
        s->intsts &= ~value;
        break;
    case A_RTC_TICK:
        s->tick_period = value & TICK_MASK;
        s->tick = rtc_tick(s);
        break;
    case A_RTC_PWRCTL:
        s->pwrctl = value;
        rtc_log_bits(s, addr, value & ~R_RTC_PWRCTL_ALARM_EN_MASK);
        break;
    case A_RTC_SPR0 ... A_RTC_SPR15:
        s->spare[(addr - A_RTC_SPR0) / 4] = value;
        break;
    default:
        nuc980_unimp_once(s->seen, TYPE_NUC980_RTC, addr);
        break;
    }
}

static bool rtc_moves_alarm(hwaddr addr)
{
    return (addr >= A_RTC_TIME && addr <= A_RTC_CALM) || addr == A_RTC_PWRCTL;
}

static void rtc_write(void *opaque, hwaddr addr, uint64_t value, unsigned size)
{
    NUC980RTCState *s = opaque;

    trace_nuc980_rtc_write(addr, value);
    rtc_sync(s);
    if (rtc_is_protected(addr) && !rtc_is_open(s)) {
        qemu_log_mask(LOG_GUEST_ERROR, "%s: 0x%" HWADDR_PRIx " = 0x%" PRIx64
                      " needs RWEN's key first\n", TYPE_NUC980_RTC, addr,
                      value);
        return;
    }
    rtc_write_register(s, addr, value);
    s->busy_until_ns = rtc_in_clocks(WRITE_CLOCKS);
    if (rtc_moves_alarm(addr)) {
        s->alarm_ns = rtc_find_alarm(s);
    }
    rtc_update(s);
}

static const MemoryRegionOps rtc_ops = {
    .read = rtc_read,
    .write = rtc_write,
    .endianness = DEVICE_LITTLE_ENDIAN,
    .valid = { .min_access_size = 4, .max_access_size = 4 },
};

static void rtc_reset(DeviceState *dev)
{
    NUC980RTCState *s = NUC980_RTC(dev);

    s->open_until_ns = s->busy_until_ns = 0;
    s->inten = s->intsts = 0;
    s->tick = rtc_tick(s);
    rtc_update(s);
}

static int rtc_post_load(void *opaque, int version_id)
{
    NUC980RTCState *s = opaque;

    if (s->tick_period > TICK_MASK) {
        return -EINVAL;
    }
    rtc_update(s);
    return 0;
}

static const VMStateDescription vmstate_nuc980_rtc = {
    .name = TYPE_NUC980_RTC,
    .version_id = 3,
    .minimum_version_id = 3,
    .post_load = rtc_post_load,
    .fields = (VMStateField[]) {
        VMSTATE_BOOL(active, NUC980RTCState),
        VMSTATE_INT64(offset, NUC980RTCState),
        VMSTATE_INT32(weekday_offset, NUC980RTCState),
        VMSTATE_INT64(open_until_ns, NUC980RTCState),
        VMSTATE_INT64(busy_until_ns, NUC980RTCState),
        VMSTATE_INT64(alarm_ns, NUC980RTCState),
        VMSTATE_INT64(tick, NUC980RTCState),
        VMSTATE_UINT32(freqadj, NUC980RTCState),
        VMSTATE_UINT32(timefmt, NUC980RTCState),
        VMSTATE_UINT32(talm, NUC980RTCState),
        VMSTATE_UINT32(calm, NUC980RTCState),
        VMSTATE_UINT32(inten, NUC980RTCState),
        VMSTATE_UINT32(intsts, NUC980RTCState),
        VMSTATE_UINT32(tick_period, NUC980RTCState),
        VMSTATE_UINT32(pwrctl, NUC980RTCState),
        VMSTATE_UINT32_ARRAY(spare, NUC980RTCState, NUC980_RTC_SPARES),
        VMSTATE_END_OF_LIST()
    }
};

static Property rtc_properties[] = {
    DEFINE_PROP_BOOL("battery", NUC980RTCState, battery, true),
    DEFINE_PROP_END_OF_LIST(),
};

/* Not at reset: the battery's */
static void rtc_init(Object *obj)
{
    NUC980RTCState *s = NUC980_RTC(obj);

    s->timefmt = R_RTC_TIMEFMT_H24_MASK;      /* guess */
    s->alarm_ns = INT64_MAX;
    memory_region_init_io(&s->iomem, obj, &rtc_ops, s, TYPE_NUC980_RTC,
                          NUC980_RTC_SIZE);
    sysbus_init_mmio(SYS_BUS_DEVICE(obj), &s->iomem);
    sysbus_init_irq(SYS_BUS_DEVICE(obj), &s->irq);
    s->timer = timer_new_ns(rtc_clock, rtc_expired, s);
}

static void rtc_finalize(Object *obj)
{
    timer_free(NUC980_RTC(obj)->timer);
}

static void rtc_class_init(ObjectClass *klass, void *data)
{
    DeviceClass *dc = DEVICE_CLASS(klass);

    dc->reset = rtc_reset;
    dc->vmsd = &vmstate_nuc980_rtc;
    device_class_set_props(dc, rtc_properties);
}

static const TypeInfo rtc_types[] = {
    {
        .name = TYPE_NUC980_RTC,
        .parent = TYPE_SYS_BUS_DEVICE,
        .instance_size = sizeof(NUC980RTCState),
        .instance_init = rtc_init,
        .instance_finalize = rtc_finalize,
        .class_init = rtc_class_init,
    },
};

DEFINE_TYPES(rtc_types)

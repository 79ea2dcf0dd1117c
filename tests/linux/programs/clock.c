/* SPDX-License-Identifier: GPL-3.0-or-later */
/*
 * clock read: writes the time of /dev/rtc0.
 * clock set YYYY-MM-DDThh:mm:ss [TIMES]: sets it, once or so many times.
 * clock alarm SECONDS: sets its alarm that far ahead and waits for it; writes how many seconds late it came.
 *
 * By the driver's own calls: time_t of the image's programs ends in 2038, and hwclock's dates with it.
 */
#include <fcntl.h>
#include <linux/rtc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

/* struct rtc_time begins as struct tm does */
static struct tm to_tm(const struct rtc_time *rtc)
{
	struct tm tm = {0};

	memcpy(&tm, rtc, sizeof(*rtc));
	return tm;
}

static struct rtc_time to_rtc(const struct tm *tm)
{
	struct rtc_time rtc;

	memcpy(&rtc, tm, sizeof(rtc));
	return rtc;
}

static int read_clock(int fd)
{
	struct rtc_time rtc;

	if (ioctl(fd, RTC_RD_TIME, &rtc) < 0)
		return -1;
	printf("%04d-%02d-%02dT%02d:%02d:%02d\n", rtc.tm_year + 1900, rtc.tm_mon + 1, rtc.tm_mday,
	       rtc.tm_hour, rtc.tm_min, rtc.tm_sec);
	return 0;
}

static int set_clock(int fd, const char *text, int times)
{
	struct tm tm = {0};
	struct rtc_time rtc;

	if (!strptime(text, "%Y-%m-%dT%H:%M:%S", &tm))
		return -1;
	rtc = to_rtc(&tm);
	for (int i = 0; i < times; i++)
		if (ioctl(fd, RTC_SET_TIME, &rtc) < 0)
			return -1;
	return 0;
}

static int wait_for_alarm(int fd, int seconds)
{
	struct rtc_wkalrm alarm = {.enabled = 1};
	struct rtc_time rtc;
	unsigned long events;
	struct tm tm;
	time_t at;

	if (ioctl(fd, RTC_RD_TIME, &rtc) < 0)
		return -1;
	tm = to_tm(&rtc);
	at = timegm(&tm) + seconds;
	alarm.time = to_rtc(gmtime(&at));
	if (ioctl(fd, RTC_WKALM_SET, &alarm) < 0 || read(fd, &events, sizeof(events)) != sizeof(events) ||
	    ioctl(fd, RTC_RD_TIME, &rtc) < 0)
		return -1;
	tm = to_tm(&rtc);
	printf("%s %lld\n", events & RTC_AF ? "alarm" : "other", (long long)(timegm(&tm) - at));
	return 0;
}

static int run(int fd, int argc, char **argv)
{
	if (argc == 2 && strcmp(argv[1], "read") == 0)
		return read_clock(fd);
	if (argc >= 3 && strcmp(argv[1], "set") == 0)
		return set_clock(fd, argv[2], argc == 4 ? atoi(argv[3]) : 1);
	return argc == 3 ? wait_for_alarm(fd, atoi(argv[2])) : -1;
}

int main(int argc, char **argv)
{
	int fd = open("/dev/rtc0", O_RDONLY);

	if (fd < 0 || run(fd, argc, argv) < 0) {
		perror("/dev/rtc0");
		return 1;
	}
	return 0;
}

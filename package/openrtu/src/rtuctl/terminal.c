/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtuctl/terminal.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

/* ECMA-48, and xterm's other screen. */
#define ENTER      "\033[?1049h\033[?25l"
#define LEAVE      "\033[?25h\033[?1049l"
#define HOME       "\033[H"
#define CLEAR_LINE "\033[0m\033[K"
#define CLEAR_REST "\033[J"
#define ESCAPE     '\033'
#define KEY_SIZE   8

static struct termios before;
static volatile sig_atomic_t ended;

static void end(int signal_number)
{
	(void)signal_number;
	ended = 1;
}

static void wake(int signal_number)
{
	(void)signal_number;
}

/* Without SA_RESTART: they end the wait for a key. */
static void hear_signals(void)
{
	const struct sigaction ending = {.sa_handler = end}, waking = {.sa_handler = wake};

	sigaction(SIGINT, &ending, NULL);
	sigaction(SIGTERM, &ending, NULL);
	sigaction(SIGHUP, &ending, NULL);
	sigaction(SIGWINCH, &waking, NULL);
}

bool terminal_open(void)
{
	const char *name = getenv("TERM");
	struct termios own;

	if (!isatty(STDIN_FILENO) || !isatty(STDOUT_FILENO) || name == NULL || strcmp(name, "dumb") == 0 ||
	    tcgetattr(STDIN_FILENO, &before) < 0)
		return false;
	hear_signals();
	own = before;
	own.c_lflag &= ~(tcflag_t)(ICANON | ECHO);
	tcsetattr(STDIN_FILENO, TCSANOW, &own);
	fputs(ENTER, stdout);
	return true;
}

void terminal_close(void)
{
	fputs(LEAVE, stdout);
	fflush(stdout);
	tcsetattr(STDIN_FILENO, TCSANOW, &before);
}

struct terminal_size terminal_size(void)
{
	struct winsize size;

	if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) < 0 || size.ws_row == 0 || size.ws_col == 0)
		return (struct terminal_size){.rows = 24, .columns = 80};
	return (struct terminal_size){.rows = size.ws_row, .columns = size.ws_col};
}

/* ---- keys -------------------------------------------------------------------------------- */

static enum terminal_key key_of(const char *bytes)
{
	static const struct {
		const char *bytes;
		enum terminal_key key;
	} keys[] = {
	    {"q", TERMINAL_QUIT},          {"i", TERMINAL_FILTER},          {"k", TERMINAL_UP},
	    {"j", TERMINAL_DOWN},          {"\033[A", TERMINAL_UP},         {"\033[B", TERMINAL_DOWN},
	    {"\033OA", TERMINAL_UP},       {"\033OB", TERMINAL_DOWN},       {" ", TERMINAL_PAGE_DOWN},
	    {"\033[5~", TERMINAL_PAGE_UP}, {"\033[6~", TERMINAL_PAGE_DOWN}, {"\033[H", TERMINAL_HOME},
	    {"\033[1~", TERMINAL_HOME},
	};

	for (size_t i = 0; i < sizeof(keys) / sizeof(keys[0]); i++)
		if (strcmp(bytes, keys[i].bytes) == 0)
			return keys[i].key;
	return TERMINAL_NONE;
}

enum terminal_key terminal_key(int wait_ms)
{
	struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
	char bytes[KEY_SIZE + 1];
	ssize_t length;

	if (!ended && poll(&input, 1, wait_ms) <= 0)
		return ended ? TERMINAL_QUIT : TERMINAL_NONE;
	length = ended ? 0 : read(STDIN_FILENO, bytes, KEY_SIZE);
	if (length < 0 && errno == EINTR)
		return ended ? TERMINAL_QUIT : TERMINAL_NONE;
	if (length <= 0)
		return TERMINAL_QUIT;
	bytes[length] = '\0';
	return key_of(bytes);
}

/* ---- drawing ----------------------------------------------------------------------------- */

/* The length of a CSI sequence at the text's begin; 0: there is none. */
static size_t sequence(const char *text)
{
	size_t length = 2;

	if (text[0] != ESCAPE || text[1] != '[')
		return 0;
	while (text[length] != '\0' && (text[length] < '@' || text[length] > '~'))
		length++;
	return text[length] != '\0' ? length + 1 : length;
}

static bool starts_character(char byte)
{
	return ((unsigned char)byte & 0xc0) != 0x80;
}

size_t terminal_width(const char *text)
{
	size_t width = 0;

	while (*text != '\0') {
		size_t skipped = sequence(text);

		width += skipped == 0 && starts_character(*text);
		text += skipped != 0 ? skipped : 1;
	}
	return width;
}

/* As much of a line as fits; returns the line's end. */
static const char *draw_line(const char *text, size_t columns)
{
	size_t width = 0;

	while (*text != '\0' && *text != '\n') {
		size_t length = sequence(text);

		if (length == 0)
			width += starts_character(*text);
		if (length != 0 || width <= columns)
			fwrite(text, length != 0 ? length : 1, 1, stdout);
		text += length != 0 ? length : 1;
	}
	fputs(CLEAR_LINE, stdout);
	return text;
}

void terminal_draw(const char *text)
{
	const struct terminal_size size = terminal_size();

	fputs(HOME, stdout);
	for (size_t row = 0; *text != '\0' && row < size.rows; row++) {
		if (row > 0)
			putchar('\n');
		text = draw_line(text, size.columns);
		text += *text == '\n';
	}
	fputs(CLEAR_REST, stdout);
	fflush(stdout);
}

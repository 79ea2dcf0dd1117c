/*
 * Nuvoton NUC980 flash memory interface: its error-correcting code
 *
 * The names are those of Lin and Costello, Error Control Coding, chapter 6.
 *
 * SPDX-License-Identifier: GPL-2.0-or-later
 */

#include "qemu/osdep.h"
#include "hw/block/nuc980_bch.h"
#include "qemu/bswap.h"

#define M           15
#define N           ((1 << M) - 1)
#define PRIMITIVE   0x8003
#define MAX_PARITY_BITS (M * NUC980_BCH_MAX_T)
#define WORDS       DIV_ROUND_UP(MAX_PARITY_BITS, 64)

/* A remainder of the division by g(x), its highest power leftmost */
typedef struct Remainder {
    uint64_t word[WORDS];
} Remainder;

struct NUC980BCH {
    unsigned t;
    unsigned parity_bits;
    unsigned words;             /* as many of a Remainder's as are in use */
    Remainder of_byte[256];     /* of b(x) * x^parity_bits */
};

static uint16_t power[2 * N];   /* alpha^i, twice: spares a modulo */
static uint16_t logarithm[N + 1];

static void make_field(void)
{
    unsigned a = 1;

    for (int i = 0; i < N; i++) {
        power[i] = power[i + N] = a;
        logarithm[a] = i;
        a <<= 1;
        if (a >> M) {
            a ^= PRIMITIVE;
        }
    }
}

static unsigned gf_mul(unsigned a, unsigned b)
{
    return a && b ? power[logarithm[a] + logarithm[b]] : 0;
}

static unsigned gf_div(unsigned a, unsigned b)
{
    return a ? power[logarithm[a] + N - logarithm[b]] : 0;
}

/*
 * g(x): the roots are alpha, alpha^3 .. alpha^(2t-1) and their conjugates.
 * Up to t = 24 each of these has M conjugates, and no two share one.
 */
static void make_generator(unsigned t, uint16_t g[MAX_PARITY_BITS + 1])
{
    unsigned degree = 0;

    memset(g, 0, (MAX_PARITY_BITS + 1) * sizeof(g[0]));
    g[0] = 1;
    for (unsigned i = 1; i < 2 * t; i += 2) {
        for (unsigned k = 0, root = i; k < M; k++, root = root * 2 % N) {
            for (unsigned d = ++degree; d; d--) {
                g[d] = g[d - 1] ^ gf_mul(g[d], power[root]);
            }
            g[0] = gf_mul(g[0], power[root]);
        }
    }
}

static void shift_left(Remainder *r, unsigned words, unsigned bits)
{
    for (unsigned w = 0; w < words; w++) {
        uint64_t next = w + 1 < words ? r->word[w + 1] : 0;

        r->word[w] = r->word[w] << bits | next >> (64 - bits);
    }
}

static void add(Remainder *r, unsigned words, const Remainder *other)
{
    for (unsigned w = 0; w < words; w++) {
        r->word[w] ^= other->word[w];
    }
}

static void make_code(NUC980BCH *code, unsigned t)
{
    uint16_t g[MAX_PARITY_BITS + 1];
    Remainder divisor = {};     /* g(x) without its highest power */

    code->t = t;
    code->parity_bits = M * t;
    code->words = DIV_ROUND_UP(code->parity_bits, 64);
    make_generator(t, g);
    for (unsigned i = 0; i < code->parity_bits; i++) {
        if (g[code->parity_bits - 1 - i]) {
            divisor.word[i / 64] |= 1ull << (63 - i % 64);
        }
    }
    for (unsigned byte = 0; byte < 256; byte++) {
        Remainder *r = &code->of_byte[byte];

        r->word[0] = (uint64_t)byte << 56;
        for (int bit = 0; bit < 8; bit++) {
            bool divide = r->word[0] >> 63;

            shift_left(r, code->words, 1);
            if (divide) {
                add(r, code->words, &divisor);
            }
        }
    }
}

const NUC980BCH *nuc980_bch(unsigned t)
{
    static const uint8_t ts[] = { 4, 8, 12, 15, 24 };
    static NUC980BCH codes[ARRAY_SIZE(ts)];
    static bool made;

    if (!made) {
        make_field();
        for (int i = 0; i < ARRAY_SIZE(ts); i++) {
            make_code(&codes[i], ts[i]);
        }
        made = true;
    }
    for (int i = 0; i < ARRAY_SIZE(ts); i++) {
        if (ts[i] == t) {
            return &codes[i];
        }
    }
    g_assert_not_reached();
}

unsigned nuc980_bch_parity_size(const NUC980BCH *code)
{
    return DIV_ROUND_UP(code->parity_bits, 8);
}

static Remainder divide(const NUC980BCH *code, const uint8_t *message,
                        size_t size)
{
    Remainder r = {};

    for (size_t i = 0; i < size; i++) {
        unsigned byte = r.word[0] >> 56 ^ message[i];

        shift_left(&r, code->words, 8);
        add(&r, code->words, &code->of_byte[byte]);
    }
    return r;
}

void nuc980_bch_encode(const NUC980BCH *code, const uint8_t *message,
                       size_t size, uint8_t *parity)
{
    Remainder r = divide(code, message, size);

    for (unsigned w = 0; w < code->words; w++) {
        r.word[w] = cpu_to_be64(r.word[w]);
    }
    memcpy(parity, r.word, nuc980_bch_parity_size(code));
}

/* The values of r(x) at alpha, alpha^2 .. alpha^2t: S[1] to S[2t] */
static void syndromes(const NUC980BCH *code, const Remainder *r,
                      uint16_t S[2 * NUC980_BCH_MAX_T + 1])
{
    memset(S, 0, (2 * NUC980_BCH_MAX_T + 1) * sizeof(S[0]));
    for (unsigned i = 0; i < code->parity_bits; i++) {
        unsigned degree = code->parity_bits - 1 - i;

        if (r->word[i / 64] >> (63 - i % 64) & 1) {
            for (unsigned j = 1; j <= 2 * code->t; j++) {
                S[j] ^= power[j * degree % N];
            }
        }
    }
}

/*
 * Berlekamp and Massey: the error-location polynomial of the least degree
 * that makes all the syndromes. Returns that degree, or -1 when it is above t.
 */
static int locator(const NUC980BCH *code,
                   const uint16_t S[2 * NUC980_BCH_MAX_T + 1],
                   uint16_t sigma[2 * NUC980_BCH_MAX_T + 1])
{
    uint16_t old[2 * NUC980_BCH_MAX_T + 1] = { 1 };
    unsigned old_discrepancy = 1, length = 0, gap = 1;
    const unsigned last = 2 * code->t;

    memset(sigma, 0, sizeof(old));
    sigma[0] = 1;
    for (unsigned n = 0; n < last; n++, gap++) {
        uint16_t before[2 * NUC980_BCH_MAX_T + 1];
        unsigned discrepancy = S[n + 1], factor;

        for (unsigned i = 1; i <= length; i++) {
            discrepancy ^= gf_mul(sigma[i], S[n + 1 - i]);
        }
        if (!discrepancy) {
            continue;
        }
        memcpy(before, sigma, sizeof(before));
        factor = gf_div(discrepancy, old_discrepancy);
        for (unsigned i = 0; i + gap <= last; i++) {
            sigma[i + gap] ^= gf_mul(factor, old[i]);
        }
        if (2 * length <= n) {
            length = n + 1 - length;
            memcpy(old, before, sizeof(old));
            old_discrepancy = discrepancy;
            gap = 0;
        }
    }
    return length <= code->t ? length : -1;
}

/* Chien: an error at the power d makes alpha^-d a root of sigma(x). */
static int roots(const uint16_t sigma[2 * NUC980_BCH_MAX_T + 1], int degree,
                 unsigned bits, unsigned where[NUC980_BCH_MAX_T])
{
    int found = 0;

    for (unsigned i = 0; i < bits; i++) {
        unsigned d = bits - 1 - i, sum = sigma[0];

        for (int j = 1; j <= degree; j++) {
            if (sigma[j]) {
                sum ^= power[logarithm[sigma[j]] + (N - d) * j % N];
            }
        }
        if (!sum) {
            where[found++] = i;
            if (found == degree) {
                return found;
            }
        }
    }
    return -1;
}

int nuc980_bch_decode(const NUC980BCH *code, const uint8_t *message,
                      size_t size, const uint8_t *parity,
                      unsigned where[NUC980_BCH_MAX_T])
{
    Remainder r = divide(code, message, size), received = {};
    uint16_t S[2 * NUC980_BCH_MAX_T + 1], sigma[2 * NUC980_BCH_MAX_T + 1];
    uint64_t difference = 0;
    int degree;

    memcpy(received.word, parity, nuc980_bch_parity_size(code));
    for (unsigned w = 0; w < code->words; w++) {
        r.word[w] ^= be64_to_cpu(received.word[w]);
    }
    /* The bits that fill the parity's last byte are none of the code's. */
    if (code->parity_bits % 64) {
        r.word[code->words - 1] &= -1ull << (64 - code->parity_bits % 64);
    }
    for (unsigned w = 0; w < code->words; w++) {
        difference |= r.word[w];
    }
    if (!difference) {
        return 0;
    }
    syndromes(code, &r, S);
    degree = locator(code, S, sigma);
    return degree < 0 ? -1 : roots(sigma, degree, 8 * size + code->parity_bits,
                                   where);
}

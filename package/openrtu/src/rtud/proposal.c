/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "rtud/proposal.h"

#include <string.h>

#include "map/time_ns.h"

static bool is_by(const struct proposal *proposal, const char *user)
{
	return strcmp(proposal->user, user) == 0;
}

static enum proposal_task enter(struct proposal *proposal, enum proposal_phase phase, enum proposal_task task)
{
	proposal->phase = phase;
	return task;
}

static enum proposal_task ask_check(struct proposal *proposal, const char *user)
{
	if (proposal->phase != PROPOSAL_NONE && proposal->phase != PROPOSAL_CHECKED)
		return PROPOSAL_REFUSE;
	*proposal = (struct proposal){.phase = PROPOSAL_CHECKING};
	strncpy(proposal->user, user, sizeof(proposal->user) - 1);
	return PROPOSAL_CHECK;
}

/* What its user has seen, and no other text. */
static enum proposal_task ask_apply(struct proposal *proposal, const char *user, uint32_t text)
{
	if (proposal->phase != PROPOSAL_CHECKED || !is_by(proposal, user) || proposal->text != text)
		return PROPOSAL_REFUSE;
	return enter(proposal, PROPOSAL_APPLYING, PROPOSAL_APPLY);
}

static enum proposal_task ask_confirm(struct proposal *proposal, const char *user, uint32_t text,
				      int64_t now_ns)
{
	if (proposal->phase != PROPOSAL_TRIAL || !is_by(proposal, user) || proposal->text != text ||
	    now_ns >= proposal->until_ns)
		return PROPOSAL_REFUSE;
	return enter(proposal, PROPOSAL_KEEPING, PROPOSAL_KEEP);
}

enum proposal_task proposal_ask(struct proposal *proposal, enum setup_wish wish, const char *user,
				uint32_t text, int64_t now_ns)
{
	switch (wish) {
	case SETUP_CHECK:
		return ask_check(proposal, user);
	case SETUP_APPLY:
		return ask_apply(proposal, user, text);
	case SETUP_CONFIRM:
		return ask_confirm(proposal, user, text, now_ns);
	case SETUP_RETURN:
		if (proposal->phase == PROPOSAL_TRIAL)
			return enter(proposal, PROPOSAL_RETURNING, PROPOSAL_GO_BACK);
		break;
	case SETUP_SHOW:
	case SETUP_WISHES:
		break;
	}
	return PROPOSAL_REFUSE;
}

enum proposal_task proposal_ended(struct proposal *proposal, bool good, uint32_t text, int64_t now_ns)
{
	switch (proposal->phase) {
	case PROPOSAL_CHECKING:
		proposal->text = text;
		return enter(proposal, good ? PROPOSAL_CHECKED : PROPOSAL_NONE, PROPOSAL_NOTHING);
	case PROPOSAL_APPLYING:
		proposal->until_ns = now_ns + SETUP_TRIAL_S * NS_PER_S;
		return enter(proposal, good ? PROPOSAL_TRIAL : PROPOSAL_NONE, PROPOSAL_NOTHING);
	case PROPOSAL_KEEPING:
		return good ? enter(proposal, PROPOSAL_NONE, PROPOSAL_NOTHING)
			    : enter(proposal, PROPOSAL_RETURNING, PROPOSAL_GO_BACK);
	case PROPOSAL_RETURNING:
		proposal->until_ns = now_ns + PROPOSAL_AGAIN_S * NS_PER_S;
		return enter(proposal, good ? PROPOSAL_NONE : PROPOSAL_STUCK, PROPOSAL_NOTHING);
	case PROPOSAL_NONE:
	case PROPOSAL_CHECKED:
	case PROPOSAL_TRIAL:
	case PROPOSAL_STUCK:
		break;
	}
	return PROPOSAL_NOTHING;
}

enum proposal_task proposal_wait(struct proposal *proposal, int64_t now_ns)
{
	if ((proposal->phase != PROPOSAL_TRIAL && proposal->phase != PROPOSAL_STUCK) ||
	    now_ns < proposal->until_ns)
		return PROPOSAL_NOTHING;
	return enter(proposal, PROPOSAL_RETURNING, PROPOSAL_GO_BACK);
}

bool proposal_begins(struct proposal_pace *pace, int64_t now_ns)
{
	if (pace->paid_ns < now_ns)
		pace->paid_ns = now_ns;
	if (pace->paid_ns - now_ns > (PROPOSAL_AT_ONCE - 1) * NS_PER_S)
		return false;
	pace->began_ns = now_ns;
	pace->paid_ns += NS_PER_S;
	return true;
}

void proposal_rests(struct proposal_pace *pace, int64_t now_ns)
{
	pace->paid_ns += now_ns - pace->began_ns;
	pace->began_ns = now_ns;
}

bool proposal_holds(const struct proposal *proposal)
{
	return proposal->phase >= PROPOSAL_APPLYING && proposal->phase != PROPOSAL_STUCK;
}

const char *proposal_phase_name(enum proposal_phase phase)
{
	static const char *const names[] = {
	    [PROPOSAL_NONE] = "none",           [PROPOSAL_CHECKING] = "checking",
	    [PROPOSAL_CHECKED] = "checked",     [PROPOSAL_APPLYING] = "applying",
	    [PROPOSAL_TRIAL] = "trial",         [PROPOSAL_KEEPING] = "keeping",
	    [PROPOSAL_RETURNING] = "returning", [PROPOSAL_STUCK] = "stuck",
	};

	return names[phase];
}

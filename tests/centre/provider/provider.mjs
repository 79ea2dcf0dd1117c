// SPDX-License-Identifier: GPL-3.0-or-later
// A real provider of OpenID Connect for the tests of the centre: node provider.mjs NODE_MODULES PORT CENTRE CLIENT SECRET.
// Whoever writes a name into its page is this user. Each start has keys of its own.
import { createRequire } from "node:module";
import { generateKeyPairSync } from "node:crypto";
import { pathToFileURL } from "node:url";

const [modules, port, centre, client, secret] = process.argv.slice(2);
const found = createRequire(`${modules}/`).resolve("oidc-provider");
const { default: Provider } = await import(pathToFileURL(found));
const GROUPS = { anna: ["staff", "ops"], carla: ["chiefs"], guest: ["staff"] };

const { privateKey } = generateKeyPairSync("rsa", { modulusLength: 2048 });
const key = { ...privateKey.export({ format: "jwk" }), use: "sig", alg: "RS256", kid: `of process ${process.pid}` };

const provider = new Provider(`http://localhost:${port}`, {
  clients: [{
    client_id: client,
    client_secret: secret,
    redirect_uris: [`${centre}/api/oidc/callback`],
    post_logout_redirect_uris: [`${centre}/`],
    backchannel_logout_uri: `${centre}/api/oidc/logout`,
    backchannel_logout_session_required: true,
  }],
  jwks: { keys: [key] },
  cookies: { keys: ["of a test"] },
  scopes: ["openid", "profile", "groups"],
  claims: { openid: ["sub"], profile: ["preferred_username"], groups: ["groups"] },
  conformIdTokenClaims: true, // what it says of a user stands at its userinfo end point alone
  fetch: (url, { dispatcher, ...options }) => fetch(url, options), // the centre is on this machine, where it would ask nobody
  features: { backchannelLogout: { enabled: true } },
  findAccount: (_, id) => ({ accountId: id, claims: () => ({ sub: id, preferred_username: id, groups: GROUPS[id] }) }),
});
provider.listen(Number(port), "127.0.0.1", () => console.log("ready"));

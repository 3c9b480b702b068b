"""Names under which a port forwarder shows the page."""

from simmer_tui.web.page_access import PageAccess


def test_only_the_names_given_are_accepted_and_their_links_have_the_word() -> None:
    name = "me-9080.app.github.dev"
    access = PageAccess(words=True, control=False, names=(name.upper(),))
    assert access.is_host(name)
    assert access.is_host(f"{name}:443")
    assert not access.is_host("evil.example")
    assert access.is_origin(f"https://{name}", name)
    assert access.is_origin(f"https://{name}", "localhost:9080")
    assert not access.is_origin("https://evil.example", "localhost:9080")
    assert not access.is_origin(f"https://{name}.evil.example", "localhost:9080")
    assert not PageAccess(words=True, control=False).is_host(name)
    here, there = (link.address for link in access.links("127.0.0.1", 9080))
    assert there == f"https://{name}/#{here.partition('#')[2]}"

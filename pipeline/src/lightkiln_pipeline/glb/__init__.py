"""Binary glTF 2.0: a writer for scenes and a reader for what the baker made of them."""

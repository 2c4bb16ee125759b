"""The league of architectures, edition 2; see README.md beside this file."""

"""A finding for people: its words, its pictures, its page. Plain data in, text out."""
